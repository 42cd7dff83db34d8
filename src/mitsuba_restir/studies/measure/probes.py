"""Probes: what frames with auxiliary images say, which no run of a study keeps.

What `restir_pt` says of its frames, the paths that pixels share, what a guided denoiser makes of
frames, and spectra of mutations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from ...analysis import metrics
from ...analysis.denoise import denoise
from ...analysis.duplication import duplicated_share
from ..config.study import Size, Study
from ..runs.probing import previewed_frames, probed_frames
from ..runs.results import ReferenceImage
from . import mutation_spectra, previews

LoadReference = Callable[[], ReferenceImage | None]
Probe = Callable[[Study, Size, str, int, LoadReference], Mapping[str, float]]
"""Measures (study, size, name of the variant, number of the run, what loads the reference)."""


def _mean(frames: list[dict[str, float]]) -> dict[str, float]:
    names = dict.fromkeys(name for frame in frames for name in frame)
    return {name: float(np.mean([f[name] for f in frames if name in f])) for name in names}


def _statistics(
    study: Study, size: Size, name: str, index: int, _: LoadReference
) -> dict[str, float]:
    """Mean over the frames: what the integrator says of each, and the share of duplicated paths."""
    stages = ("before mutations", "after mutations", "after spatial reuse")
    return _mean(
        [
            _flat(numbers)
            | {
                f"duplicated paths r=8, {stage}": duplicated_share(paths)
                for stage, paths in zip(
                    stages, np.moveaxis(tensor[..., -3:].astype(np.int64), -1, 0), strict=True
                )
            }
            for tensor, numbers in probed_frames(study, size, name, index, "path")
        ]
    )


def _flat(table: Mapping[str, Any], prefix: str = "") -> dict[str, float]:
    flat: dict[str, float] = {}
    for name, value in table.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{prefix}{name}: ")
        elif isinstance(value, bool | int | float):
            flat[f"{prefix}{name}"] = float(value)
    return flat


def _mutation_spectra(
    study: Study, size: Size, name: str, index: int, load_reference: LoadReference
) -> dict[str, float]:
    """Spectra before and after spatial reuse."""
    reference = load_reference()
    assert reference is not None
    frames = probed_frames(study, size, name, index, mutation_spectra.CHANNELS)
    return _mean([mutation_spectra.numbers(tensor, reference) for tensor, _ in frames])


def _guided_denoising(
    study: Study, size: Size, name: str, index: int, load_reference: LoadReference
) -> dict[str, float]:
    """Mean over the frames: relMSE after the denoiser that ``render --denoise`` runs."""
    reference = load_reference()
    assert reference is not None
    found = []
    for tensor, _ in probed_frames(study, size, name, index, "albedo,sh_normal"):
        clean = denoise(*np.split(tensor, 3, axis=-1))
        relmse = partial(
            metrics.trimmed_relmse,
            clean,
            reference.image,
            epsilon=study.epsilon,
            reference_variance=reference.variance,
        )
        found.append({GUIDED: relmse(trim=0.0), GUIDED_TRIMMED: relmse(trim=study.trim)})
    return _mean(found)


def _previews(
    study: Study, size: Size, name: str, index: int, load_reference: LoadReference
) -> dict[str, float]:
    """What previews of a still are, relative to the mean that they are of."""
    reference = load_reference()
    assert reference is not None
    found: dict[str, float] = {}
    for count, mean, shown in previewed_frames(study, size, name, index, previews.COUNTS):
        found |= previews.ratios(mean, shown, reference, count)
    return found


GUIDED = "relMSE after OIDN with albedo and normals"
GUIDED_TRIMMED = f"{GUIDED}, trimmed"

PROBES: Mapping[str, Probe] = {
    "statistics": _statistics,
    "mutation_spectra": _mutation_spectra,
    "guided_denoising": _guided_denoising,
    previews.PROBE: _previews,
}
"""Probes by name."""
