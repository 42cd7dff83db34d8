"""Colour history: the running mean of every pixel's plain average, which steers selection."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

MEMORY = 16
"""Frames after which the mean becomes exponential: older frames fade by 1/16 a frame."""


@dataclass
class ColorHistory:
    """What earlier frames say about a pixel's colour.

    Fields: ``color`` (``Color3f``, mean of the plain averages, light seen directly left out),
    ``frames`` (``Float``, how many frames it averages; at most :data:`MEMORY`).
    """

    color: Any
    frames: Any


def no_color_history() -> ColorHistory:
    """The colour history of a surface that has not been seen before."""
    return ColorHistory(mi.Color3f(0), mi.Float(0))


def remember(before: ColorHistory, mean: Any) -> ColorHistory:
    """The colour history with this frame in it.

    Parameters
    ----------
    before : ColorHistory
        Of the same surface in the previous frame; without frames where there is none.
    mean : Color3f
        This frame's plain average of the pair estimators. Nothing that selection chose may get
        here: the history would follow its own choices.
    """
    frames = dr.minimum(before.frames + 1, MEMORY)
    return ColorHistory(before.color + (mean - before.color) / frames, frames)
