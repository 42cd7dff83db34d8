"""Colour history: the running mean of every pixel's plain average, which steers selection."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..paths.grid import Grid
from ..paths.spectrum import target
from .around import local_mean

MEMORY = 64
"""Frames after which the newest's share stays as it is then, and the mean becomes exponential."""


@dataclass
class ColorHistory:
    """What earlier frames say about a pixel's colour.

    Fields: ``color`` (mean of the plain averages, light seen directly left out), ``frames`` (how
    many frames it knows; at most :data:`MEMORY`).
    """

    color: mi.Color3f
    frames: mi.Float


def no_color_history() -> ColorHistory:
    """The colour history of a surface that has not been seen before."""
    return ColorHistory(mi.Color3f(0), mi.Float(0))


def remember(before: ColorHistory, mean: mi.Color3f) -> ColorHistory:
    """The colour history with this frame in it.

    Frame n of a surface counts in proportion to n: its reservoirs, too, know little at first, and
    noise of the first frames that stayed in the mean would be worse than no history.

    Parameters
    ----------
    before : ColorHistory
        Of the same surface in the previous frame; without frames where there is none.
    mean : Color3f
        This frame's plain average of the pair estimators. Nothing that selection chose may get
        here: the history would follow its own choices.
    """
    frames = dr.minimum(before.frames + 1, MEMORY)
    after = ColorHistory(dr.lerp(before.color, mean, 2 / (frames + 1)), frames)
    # A mean that is not finite would stay for ever.
    return dr.select(dr.all(dr.isfinite(after.color)), after, before)


def clamped(grid: Grid, color: mi.Color3f, mean: mi.Color3f, alike: mi.UInt32) -> mi.Color3f:
    """The history, within one standard deviation of the current frame around each pixel.

    Behind the edge of a shadow that moves, it forgets where the edge was. Channel by channel, over
    similar pixels; the usual clamp of temporal antialiasing.

    Parameters
    ----------
    color, mean : Color3f
        Colour history and this frame's plain average.
    alike : UInt32
        Result of :func:`.around.similar_neighbors`.
    """
    centre, square = (local_mean(grid, x, alike) for x in (mean, mean * mean))
    deviation = dr.sqrt(dr.maximum(square - centre * centre, 0))
    # From 1e19 on single precision cannot hold the squares, and the history is left as it is.
    known = dr.isfinite(square - centre * centre)
    return dr.select(known, dr.clip(color, centre - deviation, centre + deviation), color)


def relit(
    grid: Grid, color: mi.Color3f, mean: mi.Color3f, alike: mi.UInt32, further: mi.UInt32
) -> mi.Color3f:
    """The history, made as bright as the current frame around each pixel.

    Where the light changes, the history tells where it was. Multiplied by the ratio of local means
    of luminance (of similar pixels; standard deviation 2.8 pixels) it keeps its detail and takes
    the brightness of the frame; so also the frame's noise of lower frequencies.

    Parameters
    ----------
    color, mean : Color3f
        Colour history and this frame's plain average.
    alike, further : UInt32
        Results of :func:`.around.similar_neighbors` at step 1 and 2.
    """
    before, now = target(color), target(mean)
    for step, counted in enumerate((alike, further), 1):
        before, now = (local_mean(grid, x, counted, step) for x in (before, now))
    return color * dr.select(before > 0, now / before, 0)
