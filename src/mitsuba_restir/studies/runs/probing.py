"""Frames that are rendered once more, with auxiliary images, beside the runs of a study."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ...still.driver import begun
from ...still.frames import Subject, previewed
from ...still.goal import LEAST, Goal
from ...still.growth import Growth
from ...still.picture import stopwatch
from ...still.plan import parse
from ..config.study import Size, Study
from .rendering import make_renderer, make_sensor, seed_of
from .results import Image
from .scene import load_scene
from .stills import TYPE

REFERENCED = frozenset({"mutation_spectra", "guided_denoising", "previews"})
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


def growing(study: Study, size: Size, name: str, index: int, steered: bool) -> Growth:
    """Begin a still of a variant, with a preview that is steered or without one."""
    scene, plan = load_scene(study), study.variants[name].parameters.get("plan")
    subject = Subject(
        scene,
        make_sensor(study, scene, size),
        seed_of(study.seed, KEY, index, 0),
        {"max_depth": study.max_depth},
        previewed=previewed({"blue_noise": "selection"}) if steered else None,
    )
    asked = None if plan is None else parse(str(plan))
    return begun(subject, asked, Goal(frames=max(study.frames, LEAST)), stopwatch())


def previewed_frames(
    study: Study, size: Size, name: str, index: int, counts: Collection[int]
) -> Iterator[tuple[int, Image, Image]]:
    """Render a still; after each of some numbers of frames, yield it, its mean and its preview."""
    if study.variants[name].type != TYPE:
        return
    growth = growing(study, size, name, index, steered=True)
    for now in growth.grow(Goal(frames=max(counts))):
        if now.frames in counts:
            yield now.frames, growth.picture(), growth.shown()
