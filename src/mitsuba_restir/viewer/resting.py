"""The picture while the camera rests: the mean of independent frames, as stills are made."""

from __future__ import annotations

from collections.abc import Iterator

from ..imageio import Image
from ..integrators.parameters import PARAMETERS
from ..still.frames import Frames, Subject, previewed
from ..still.goal import Goal
from ..still.growth import Growth
from ..still.picture import Progress, Still, stopwatch
from ..still.plan import PLANNED, Plan
from .camera import Pose
from .model import Side, effective
from .renderer import Renderer

ENOUGH = 0.003
"""Stated relative error at which the picture is left as it is."""

SHOWN_FROM = 16
"""Frames of the first picture: with fewer, the frame with a history that it follows is better."""


def plan_of(side: Side) -> Plan:
    """The plan of a still: what of a side's parameters leaves frames independent and unbiased."""
    values = effective(side.parameters)
    own = {name: values[name] for name in PLANNED if values[name] != PARAMETERS[name].default}
    return Plan("view", side.spp, own)


class Resting:
    """
    A still that grows as long as camera and parameters stay.

    Parameters
    ----------
    renderer : Renderer
    side : Side
    pose : Pose or None
    """

    def __init__(self, renderer: Renderer, side: Side, pose: Pose | None) -> None:
        self.side, self.pose = side, pose
        self._renderer = renderer
        values = effective(side.parameters)
        shared = {name: values[name] for name in ("max_depth", "hide_emitters")}
        renderer.place(pose, renderer.full)
        subject = Subject(
            renderer.scene,
            renderer.sensor,
            renderer.seed,
            shared,
            guides=True,
            previewed=previewed(values),
        )
        self._frames = Frames(subject, plan_of(side))
        self._begin()

    def restart(self, pose: Pose | None) -> None:
        """Begin anew, elsewhere, with what is recorded."""
        self.pose = pose
        self._frames.restart(self._renderer.seed)
        self._begin()

    def advance(self, steered: bool) -> Progress | None:
        """One more frame, steered where a preview is asked for; None where it is good enough."""
        self._growth.steer(steered)
        self._renderer.place(self.pose, self._renderer.full)
        return next(self._progress, None)

    def shown(self) -> Image:
        """What is to be seen of it: with selection a preview, else the picture as it is now."""
        return self._growth.shown()

    def still(self, denoise: bool) -> Still:
        """The picture as it is now."""
        return self._growth.still(denoise)

    def _begin(self) -> None:
        self._growth = Growth(self._frames, "asked for", stopwatch())
        self._progress: Iterator[Progress] = self._growth.grow(Goal(error=ENOUGH))
