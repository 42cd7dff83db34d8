"""Frames that are rendered once more, with auxiliary images, beside the runs of a study."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ...still.frames import previewed
from ...still.goal import Goal
from ..config.study import Size, Study
from .rendering import make_renderer, make_sensor, seed_of
from .results import Image
from .scene import load_scene
from .stills import TYPE, Stills

REFERENCED = frozenset({"mutation_spectra", "guided_denoising", "previews"})
"""Probes whose answers depend on the reference."""

KEY = 3
"""What seeds of probes are derived from, beside the study's."""

REHEARSAL = 3
"""Frames of history that there are at least: the first three compile and record."""

SIGMA = previewed({"blue_noise": "selection"})
"""Of the Gaussian through which previews are seen [pixels]: the default of selection."""

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


def stills_of(study: Study, size: Size, name: str) -> Stills:
    """Make what begins stills of a variant."""
    scene = load_scene(study)
    return Stills(study, scene, make_sensor(study, scene, size), name, study.variants[name])


def previewed_frames(
    study: Study, size: Size, name: str, index: int, counts: Collection[int]
) -> Iterator[tuple[int, Image, Image]]:
    """
    Render a still; after each of some numbers of frames, yield it, its mean and its preview.

    No further than the variant's own number of frames, where it has one. An error or a time decides
    about its plan only.
    """
    if study.variants[name].type != TYPE:
        return
    stills = stills_of(study, size, name)
    growth = stills.begun(seed_of(study.seed, KEY, index, 0), SIGMA)
    last = max(counts) if stills.goal.frames is None else min(max(counts), stills.goal.frames)
    for now in growth.grow(Goal(frames=last)):
        if now.frames in counts:
            yield now.frames, growth.picture(), growth.shown()
