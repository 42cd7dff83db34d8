"""Variants whose frames are stills: each one picture, with the choice of its plan."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ... import still
from ...errors import UsageError, one_line
from ...still.frames import check_parameters
from ...still.goal import goal_of
from ...still.picture import Still
from ...still.plan import parse
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
    last : Still or None
        The last one.

    Raises
    ------
    UsageError
        A parameter does not exist, or a value is refused.
    """

    def __init__(self, study: Study, scene: Any, sensor: Any, name: str, variant: Variant) -> None:
        self._scene, self._sensor = scene, sensor
        self._arguments: dict[str, Any] = {
            "max_depth": study.max_depth,
            "denoise": variant.denoise,
            **variant.parameters,
        }
        self.last: Still | None = None
        try:
            _check(self._arguments)
        except ValueError as error:
            raise UsageError(f"{study.name}: variant '{name}': {one_line(error)}") from error

    def draw(self, seed: int) -> Image:
        """Render a picture, (H, W, 3)."""
        self.last = still.render(self._scene, self._sensor, seed=seed, **self._arguments)
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


def _check(arguments: Mapping[str, Any]) -> None:
    """Refuse arguments that `still.render` would refuse (ValueError)."""
    own = {"max_depth", "denoise", "plan", *GOALS}
    goal_of(*(arguments.get(name) for name in GOALS))
    check_parameters({name: value for name, value in arguments.items() if name not in own})
    if "plan" in arguments:
        parse(str(arguments["plan"]))
