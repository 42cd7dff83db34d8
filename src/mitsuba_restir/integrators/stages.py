"""The stages of a frame, recorded, for one plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi

from ..guiding.policy import teaches
from ..passes.primary import camera_rays
from ..paths.camera import Camera
from ..paths.grid import grid_of
from ..paths.spectrum import Spectra
from ..sampling.dither import Dither
from ..sampling.streams import FrameKey
from .change import Change
from .frame import (
    learn_paths,
    look_back,
    meet_surfaces,
    mutate_paths,
    reuse_paths,
    sample_paths,
    share_paths,
    show_paths,
)
from .frame_data import (
    Changed,
    Frame,
    History,
    Plan,
    Rounds,
    Sampled,
    Setting,
    after_round,
)
from .recording import Stage


class Stages:
    """The halves of a frame, ``sample`` and ``share``, what is before and what between them.

    All rounds of spatial reuse are one recording: to trace a round may take longer than to render
    it.
    """

    def __init__(self, plan: Plan) -> None:
        parameters = plan.parameters
        self._changing = parameters.retrace_history
        self._images = bool(parameters.images)
        self._changes = parameters.mutates or self._images
        self._feedback = parameters.spatial_feedback
        self._selects = parameters.selects
        self._keeps = plan.keeps_rounds
        self._meet = Stage(meet_surfaces, plan)
        self._sample = Stage(sample_paths, plan)
        self._look_back = Stage(look_back, plan)
        self._reuse = Stage(reuse_paths, plan)
        self._learn = Stage(learn_paths, plan)
        self._mutate = Stage(mutate_paths, plan)
        self._share = Stage(share_paths, plan)
        self._show = Stage(show_paths, plan)

    @property
    def all(self) -> Sequence[Stage]:
        """Every stage."""
        first = (self._meet, self._sample, self._look_back, self._reuse, self._learn)
        return (*first, self._mutate, self._share, self._show)

    def setting(
        self,
        scene: mi.Scene,
        sensor: mi.Sensor,
        spectra: Spectra | None,
        key: FrameKey,
        dither: Dither | None,
    ) -> Setting:
        """What the stages are given; the camera rays are sampled and traced here.

        They are sampled outside of what is recorded: Mitsuba 3.9's sensors do not expose all of
        their state.
        """
        rays = camera_rays(sensor, grid_of(*sensor.film().crop_size()), key)
        dr.eval(rays)
        now = self._meet(scene, rays, spectra)
        return Setting(scene, spectra, now, key, dither)

    def sample(
        self,
        setting: Setting,
        history: History,
        camera: Camera | None,
        spp: int,
        change: Change | None,
    ) -> Sampled:
        """The first half; a ``change`` since the history's frame is taken back for a moment."""
        moves = None if change is None or not self._changing else change.moves
        sampled = self._sample(setting, history, camera, dr.opaque(mi.UInt32, spp), moves)
        if change is None or sampled.waiting is None:
            return sampled
        with change.undone():
            looked = self._look_back(setting, sampled, moves)
        return self._reuse(setting, sampled, looked, moves)

    def learn(self, setting: Setting, sampled: Sampled, frame: int) -> Sampled:
        """With what a frame has found, if it teaches by its number in the history."""
        if sampled.findings is None:
            return sampled
        learnt = sampled.learnt
        if teaches(frame, self._changing):
            learnt = self._learn(setting, learnt, sampled.findings)
        return replace(sampled, learnt=learnt, findings=None)

    def share(self, setting: Setting, sampled: Sampled, layouts: Sequence[Any], turn: int) -> Frame:
        """The second half: mutations, spatial reuse and shading.

        Parameters
        ----------
        layouts : sequence
            What the strategy of ``neighbor_sampling`` finds neighbours with, in each round.
        turn : int
            Running number of the frame.
        """
        changed = Changed(sampled.reservoirs, None, [])
        if self._changes:
            changed = self._mutate(setting, changed.reservoirs, dr.opaque(mi.UInt32, turn))
        reservoirs = kept = changed.reservoirs
        rounds = Rounds([], [], [sampled.outcomes])
        for index, layout in enumerate(layouts):
            shared = self._share(setting, reservoirs, layout, dr.opaque(mi.UInt32, index))
            reservoirs, rounds = shared.reservoirs, after_round(rounds, shared)
            if index < self._feedback:
                kept = reservoirs
        # To replay a stage goes through all that it is given, and only images look at the scene.
        seen = setting if self._images else replace(setting, scene=None)
        # And what it is given has copies while it is recorded or replayed.
        chosen_from = rounds if self._selects else rounds.ends
        frame = self._show(seen, sampled, changed, chosen_from, (reservoirs, kept))
        return replace(frame, rounds=rounds.known) if self._keeps else frame

    def forget(self) -> None:
        """Drop what is recorded: the scene is no longer the one that it was recorded of."""
        for stage in self.all:
            stage.forget()
