"""One frame after the other: the scene is edited, the integrator told of it, the frame rendered."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mitsuba as mi
import numpy as np

from ..errors import rendering
from ..imageio import Image, with_rgb
from .change import Watched

WARMUP = 20
"""Frames rendered before the first one that is wanted, where that is not the first of all: the
length that a history has by default."""


def seed_from(seed: int, first: int) -> int:
    """The seed of a sequence that begins at a frame: it must not repeat the numbers of another."""
    if first == 0:
        return seed
    return int(np.random.SeedSequence(seed, spawn_key=(first,)).generate_state(1)[0])


class Shot:
    """Renders the frames of a scene that moves, with the history that they leave."""

    def __init__(
        self,
        scene: mi.Scene,
        sensor: mi.Sensor,
        integrator: Any,
        update: Callable[[int], None] | None,
        spp: int,
        seed: int,
    ) -> None:
        self._scene, self._sensor, self._integrator = scene, sensor, integrator
        self._update, self._spp, self._seed = update, spp, seed
        self._watched: Watched | None = None

    def image(self, index: int) -> Image:
        """The next frame, with the auxiliary channels."""
        if self._update is not None:
            self._update(index)
        with rendering():
            if self._watched is not None:
                self._integrator.follow(self._watched.change())
            elif self._integrator.parameters.retrace_history:
                self._watched = Watched(self._scene)
            image = mi.render(
                self._scene,
                integrator=self._integrator,
                sensor=self._sensor,
                spp=self._spp,
                seed=self._seed,
            )
            return with_rgb(image, len(self._integrator.aov_names()))
