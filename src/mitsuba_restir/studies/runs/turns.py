"""One run: the frames of several variants in turn, in this process or in one of a cluster's."""

from __future__ import annotations

import platform
import uuid
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from ...errors import UsageError
from ..config.study import Size, Study
from .rendering import REHEARSAL_KEY, RUN_KEY, Renderer, make_renderer, seed_of
from .results import Image, Run
from .scene import load_scene, scene_digest
from .software import software

Seen = Callable[[str, Image | None], None]

Cluster = Callable[[Callable[..., Any], Sequence[Any]], Iterable[tuple[Any, Any]]]
"""Calls a function with many tuples of arguments; yields (arguments, answer) as they end."""


def _unseen(name: str, image: Image | None) -> None:
    """Look at no frame."""


def rehearse(study: Study, renderers: Mapping[str, Renderer]) -> None:
    """Compile all kernels, so that no measured frame does."""
    for renderer in renderers.values():
        for frame in range(renderer.rehearsal):
            seed = seed_of(study.seed, REHEARSAL_KEY, frame)
            renderer.frame_before_last(seed, renderer.rehearsal - 1 - frame)


def render_run(
    study: Study, renderers: Mapping[str, Renderer], index: int, seen: Seen = _unseen
) -> dict[str, Run]:
    """
    Render one run of several variants, which take turns at every frame.

    A pure function of the study and the number of the run, times aside: histories are reset first.

    Parameters
    ----------
    seen : callable
        Called after each frame with the variant's name and, where it is measured, the image.
    """
    for renderer in renderers.values():
        renderer.reset()
    images: dict[str, list[Image]] = {name: [] for name in renderers}
    sums: dict[str, Any] = dict.fromkeys(renderers, 0.0)
    times: dict[str, list[float]] = {name: [] for name in renderers}
    stated: dict[str, list[tuple[float, float]]] = {name: [] for name in renderers}
    names = list(renderers)
    session = uuid.uuid4().hex
    last = study.length - 1
    for frame in range(last + 1):
        seed = seed_of(study.seed, RUN_KEY, index, frame)
        # Whoever comes first changes with every frame: no variant profits from its place.
        first = (index + frame) % len(names)
        for name in names[first:] + names[:first]:
            measured = frame >= study.warmup and (frame - study.warmup) % study.stride == 0
            if not measured and not renderers[name].has_history:
                seen(name, None)
                continue
            image, seconds = renderers[name].frame_before_last(seed, last - frame)
            if measured:
                times[name].append(seconds)
                if (stills := renderers[name].stills) is not None:
                    stated[name].append(stills.stated)
                sums[name] = sums[name] + image.astype(np.float64)
                images[name] = [*images[name], image] if study.keep == "all" else [image]
            seen(name, image if measured else None)
    return {
        name: Run(
            images[name][-1],
            (sums[name] / study.frames).astype(np.float32),
            np.array(times[name]),
            partial(np.stack, images[name]) if study.keep == "all" else None,
            session,
            software(),
            np.array(stated[name]) if stated[name] else None,
            stills.remark if (stills := renderers[name].stills) is not None else "",
        )
        for name in names
    }


def remote_run(
    study: Study, scene: str, size: Size, index: int, names: list[str]
) -> dict[str, Run]:
    """
    Render one run in a worker of a cluster.

    Parameters
    ----------
    scene : str
        Digest of the scene.

    Raises
    ------
    UsageError
        The worker's scene has another content.
    """
    if scene_digest(study) != scene:
        raise UsageError(
            f"{study.name}: the scene '{study.scene}' of the worker {platform.node()} has another "
            "content: every worker needs the same files"
        )
    loaded = load_scene(study)
    renderers = {
        name: make_renderer(study, loaded, size, name, study.variants[name]) for name in names
    }
    rehearse(study, renderers)
    return render_run(study, renderers, index)
