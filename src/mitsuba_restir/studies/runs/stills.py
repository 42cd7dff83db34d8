"""Variants whose frames are stills: each one picture, with the choice of its plan."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...analysis import denoise as denoiser
from ...errors import UsageError, one_line
from ...still.driver import begun
from ...still.frames import Subject, check_parameters
from ...still.goal import Goal, goal_of
from ...still.growth import Growth
from ...still.picture import Still, stopwatch
from ...still.plan import Plan, parse
from ..config.study import Study, Variant
from .results import Image

TYPE = "still"
"""Type of such a variant."""

GOALS = ("error", "seconds", "frames")


class Stills:
    """
    Renders one still after the other.

    Parameters
    ----------
    study : Study
    scene, sensor
    name : str
        Of the variant.
    variant : Variant
        Its parameters are those of `still.render`.

    Fields
    ------
    goal : Goal
        What they are rendered to.
    last : Still or None
        The last one.

    Raises
    ------
    UsageError
        A parameter does not exist, or a value is refused.
    """

    def __init__(self, study: Study, scene: Any, sensor: Any, name: str, variant: Variant) -> None:
        self._scene, self._sensor, self._denoise = scene, sensor, variant.denoise
        self.last: Still | None = None
        given = {"max_depth": study.max_depth, **variant.parameters}
        try:
            self.goal, self._plan, self._parameters = _asked(given)
        except ValueError as error:
            raise UsageError(f"{study.name}: variant '{name}': {one_line(error)}") from error

    def begun(self, seed: int, sigma: float | None = None) -> Growth:
        """Begin one; with the Gaussian [pixels] through which its preview is seen, with one."""
        if self._denoise:
            denoiser.require()
        subject = Subject(
            self._scene,
            self._sensor,
            seed,
            self._parameters,
            guides=self._denoise,
            previewed=sigma,
        )
        return begun(subject, self._plan, self.goal, stopwatch())

    def draw(self, seed: int) -> Image:
        """Render a picture, (H, W, 3)."""
        growth = self.begun(seed)
        for _ in growth.grow(self.goal):
            pass
        self.last = growth.still(self._denoise)
        return self.last.image if self.last.denoised is None else self.last.denoised

    @property
    def stated(self) -> tuple[float, float]:
        """The errors that the last one states, without the worst pixels and with them."""
        assert self.last is not None
        return self.last.error, self.last.untrimmed

    @property
    def remark(self) -> str:
        """Plan of the last one, and why."""
        assert self.last is not None
        return f"{self.last.plan.describe()}; {self.last.frames} frames; {self.last.why}"


def _asked(arguments: Mapping[str, Any]) -> tuple[Goal, Plan | None, Mapping[str, Any]]:
    """Goal, plan and the frames' parameters, of arguments of `still.render` (ValueError)."""
    goal = goal_of(*(arguments.get(name) for name in GOALS))
    parameters = {name: arguments[name] for name in arguments if name not in ("plan", *GOALS)}
    check_parameters(parameters)
    plan = parse(str(arguments["plan"])) if "plan" in arguments else None
    return goal, plan, parameters
