"""The camera of a study, and what moves during its runs."""

from __future__ import annotations

import numpy as np
from pydantic.dataclasses import dataclass

from .values import CLOSED, Angle, Text, Vector


@dataclass(frozen=True, config=CLOSED)
class View:
    """
    A perspective camera in place of the scene's own.

    Fields
    ------
    fov : float
        Horizontal field of view in degrees.
    origin, target, up : (float, float, float)
        As in Mitsuba's ``look_at``.
    """

    fov: Angle
    origin: Vector
    target: Vector
    up: Vector = (0.0, 1.0, 0.0)

    def __post_init__(self) -> None:
        """Check that it looks somewhere (ValueError)."""
        direction = np.subtract(self.target, self.origin)
        if not direction.any():
            raise ValueError(f"target must differ from origin, {list(self.origin)}")
        if not np.cross(direction, self.up).any():
            raise ValueError("up must point elsewhere than the view")


@dataclass(frozen=True, config=CLOSED)
class Motion:
    """
    What moves evenly and arrives with the last frame of a run, where the reference is; or a cut.

    Fields
    ------
    step : (float, float, float)
        Of the camera, in world units per frame; it arrives at the study's view.
    light : str
        A parameter of the scene that is a transform, as in "light.to_world" of a rectangle that
        shines. What it moves arrives where the scene has it.
    light_step : (float, float, float)
        Its step in world units per frame.
    cut_from : View or None
        The camera until the first measured frame, where it jumps to the study's view.
    """

    step: Vector = (0.0, 0.0, 0.0)
    light: Text = ""
    light_step: Vector = (0.0, 0.0, 0.0)
    cut_from: View | None = None

    def __post_init__(self) -> None:
        """Check that something moves (ValueError)."""
        if self.cut_from is not None:
            if any(self.step) or self.light:
                raise ValueError("cut_from stands alone: leave out step and light")
            return
        if not any(self.step) and not self.light:
            raise ValueError("give a step of the camera, a light and its step, or cut_from")
        if any(self.light_step) != bool(self.light):
            raise ValueError("light and light_step go together")
