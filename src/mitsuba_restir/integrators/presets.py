"""Named operating points: what ``preset`` stands for."""

from __future__ import annotations

from collections.abc import Mapping

from .declaration import Value

PRESETS: Mapping[str, Mapping[str, Value]] = {
    "none": {},
    "fast": {"spatial_neighbors": 1},
    "raw": {
        "guiding": True,
        "roulette": "contribution",
        "spatial_rounds": 3,
        "spatial_radius": 14.0,
        "spatial_shrink": 0.6,
        "spatial_feedback": 1,
    },
    "denoised": {
        "guiding": True,
        "roulette": "contribution",
        "spatial_neighbors": 2,
        "spatial_radius": 40.0,
        "neighbor_sampling": "blue_noise",
    },
}
"""The parameters of each preset, where they are not the defaults."""


def in_words(preset: str) -> str:
    """What a preset sets, as ``name=value`` in reStructuredText."""
    return ", ".join(f"``{name}={_literal(value)}``" for name, value in PRESETS[preset].items())


def _literal(value: Value) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return value if isinstance(value, str) else f"{value:g}"
