"""Probes: frames rendered once more with auxiliary images, for what no run of a study keeps.

They are what `restir_pt` says of its frames, whose paths pixels share, and spectra of mutations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ...analysis.duplication import duplicated_share
from ..config.study import Size, Study
from ..runs.rendering import load_scene, make_renderer, seed_of
from ..runs.results import ReferenceImage
from . import mutation_spectra

KEY = 3
"""What seeds of probes are derived from, beside the study's."""

REHEARSAL = 3
"""Frames of history that there are at least: the first three compile and record."""

Tensor = npt.NDArray[Any]
LoadReference = Callable[[], ReferenceImage | None]
Probe = Callable[[Study, Size, str, int, LoadReference], Mapping[str, float]]
"""Measures (study, size, name of the variant, number of the run, what loads the reference)."""


def _frames(
    study: Study, size: Size, name: str, index: int, aovs: str
) -> Iterator[tuple[Tensor, Mapping[str, Any]]]:
    """Render the measured frames of a run with all channels; yield each with its statistics."""
    variant = study.variants[name]
    if variant.type != "restir_pt":
        return
    variant = replace(variant, parameters={**variant.parameters, "aovs": aovs})
    renderer = make_renderer(study, load_scene(study), size, name, variant)
    assert renderer.statistics is not None
    warmup = max(study.warmup, REHEARSAL)
    last = warmup + study.frames - 1
    for frame in range(last + 1):
        if renderer.place is not None:
            renderer.place(last - frame)
        tensor = np.array(renderer.draw(seed_of(study.seed, KEY, index, frame)))
        if frame >= warmup:
            yield tensor, renderer.statistics()


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
            for tensor, numbers in _frames(study, size, name, index, "path")
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
    frames = _frames(study, size, name, index, mutation_spectra.CHANNELS)
    return _mean([mutation_spectra.numbers(tensor, reference) for tensor, _ in frames])


PROBES: Mapping[str, Probe] = {"statistics": _statistics, "mutation_spectra": _mutation_spectra}
"""Probes by name."""
