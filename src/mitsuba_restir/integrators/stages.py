"""The stages of a frame, recorded, for one plan."""

from __future__ import annotations

from dataclasses import replace

from ..guiding.policy import teaches
from .frame import Plan, Sampled, Setting, learn_paths, sample_paths, share_paths
from .recording import Stage


class Stages:
    """The halves of a frame, ``sample`` and ``share``, and what is learnt between them."""

    def __init__(self, plan: Plan) -> None:
        self._changing = plan.parameters.retrace_history
        self.sample = Stage(sample_paths, plan)
        self._learn = Stage(learn_paths, plan)
        self.share = Stage(share_paths, plan)

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
        for stage in (self.sample, self._learn, self.share):
            stage.forget()
