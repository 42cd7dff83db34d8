"""The stages of a frame, recorded, for one plan."""

from __future__ import annotations

from dataclasses import replace

import drjit as dr
import mitsuba as mi

from ..guiding.policy import teaches
from ..paths.camera import Camera
from .change import Change
from .frame import learn_paths, look_back, reuse_paths, sample_paths, share_paths
from .frame_data import History, Plan, Sampled, Setting
from .recording import Stage


class Stages:
    """The halves of a frame, ``sample`` and ``share``, and what is learnt between them."""

    def __init__(self, plan: Plan) -> None:
        self._changing = plan.parameters.retrace_history
        self._sample = Stage(sample_paths, plan)
        self._look_back = Stage(look_back, plan)
        self._reuse = Stage(reuse_paths, plan)
        self._learn = Stage(learn_paths, plan)
        self.share = Stage(share_paths, plan)

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

    def forget(self) -> None:
        """Drop what is recorded: the scene is no longer the one that it was recorded of."""
        for stage in (self._sample, self._look_back, self._reuse, self._learn, self.share):
            stage.forget()
