"""Frames that are rendered once more, with auxiliary images, beside the runs of a study."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ..config.study import Size, Study
from .rendering import make_renderer, seed_of
from .scene import load_scene

REFERENCED = frozenset({"mutation_spectra", "guided_denoising"})
"""Probes whose answers depend on the reference."""

KEY = 3
"""What seeds of probes are derived from, beside the study's."""

REHEARSAL = 3
"""Frames of history that there are at least: the first three compile and record."""

Tensor = npt.NDArray[Any]


def probed_frames(
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
