"""Colour history: the running mean of every pixel's plain average, which steers selection."""

from __future__ import annotations

from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi

from ..paths.grid import Grid
from ..paths.spectrum import target
from .around import OFFSETS, colors_around, counts, local_mean, side_by_side
from .reproject import Motion

MEMORY = 64
"""Frames after which the newest's share stays as it is then, and the mean becomes exponential."""

MOVING = 16
"""Frames that a history counts at most that comes from between pixels: it blurs, and what a surface
reflects changes with the view."""

FEWEST = 8
"""What selection adds to a pixel is taken out of it in as many frames as its history counts, and at
least so many. Frames resemble those before them, and sooner their noise would be aimed at."""

DOUBTED = 2
"""Frames that a history counts at most that this frame contradicts."""

BRIGHTEST = 4.0
"""Most that is aimed higher than the history, relative to it."""

SLIGHT = 1e-3
"""Weights of reprojection below this are none: a camera at rest reads one pixel."""


@dataclass
class ColorHistory:
    """What earlier frames say about a pixel's colour.

    Fields: ``color`` (mean of the plain averages, light seen directly left out), ``frames`` (how
    many frames it knows; at most :data:`MEMORY`), ``excess`` (by how much selection has to aim
    below that mean to come out at it, see :func:`aimed`), ``alike`` (the neighbours that were
    similar when it was made, see :func:`.around.similar_neighbors`).
    """

    color: mi.Color3f
    frames: mi.Float
    excess: mi.Color3f
    alike: mi.UInt32


def no_color_history() -> ColorHistory:
    """The colour history of a surface that has not been seen before."""
    return ColorHistory(mi.Color3f(0), mi.Float(0), mi.Color3f(0), mi.UInt32(0))


@dr.syntax
def carried(grid: Grid, colors: ColorHistory, motion: Motion) -> ColorHistory:
    """The colour history where each pixel's surface was.

    Colours are interpolated by Catmull-Rom splines (Keys 1981), which hardly blur, over neighbours
    that were similar to the nearest pixel, and kept within what these have. What comes of the
    nearest pixel alone jitters: after 30 frames it is blurred by a pixel, and moved by it.
    """
    nearest = dr.gather(ColorHistory, colors, motion.pixel, motion.valid)
    (x, y), (near_x, near_y) = grid.place(grid.pixels()), grid.place(motion.pixel)
    along = mi.Float(mi.Int32(x) - mi.Int32(near_x)) + motion.flow.x
    across = mi.Float(mi.Int32(y) - mi.Int32(near_y)) + motion.flow.y
    away = dr.maximum(dr.abs(along), dr.abs(across))
    if dr.hint(motion.valid & (away > SLIGHT), label="Between pixels"):
        nearest = _interpolated(grid, colors, motion.pixel, nearest, (along, across))
    return nearest


def _interpolated(
    grid: Grid,
    colors: ColorHistory,
    pixel: mi.UInt32,
    nearest: ColorHistory,
    place: tuple[mi.Float, mi.Float],
) -> ColorHistory:
    """The colour history at a place [pixels] relative to the nearest pixel."""
    along, across = place
    weight = _spline(along) * _spline(across)
    total, low, high = weight * nearest.color, mi.Color3f(nearest.color), mi.Color3f(nearest.color)
    between = mi.Bool(False)
    for i, (dx, dy) in enumerate(OFFSETS):
        share = _spline(along - dx) * _spline(across - dy)
        active = counts(nearest.alike, i) & (dr.abs(share) > SLIGHT)
        between |= active
        other = grid.beside(pixel, (dx, dy))
        theirs = dr.gather(mi.Color3f, colors.color, other, active)
        total += dr.select(active, share * theirs, 0)
        weight += dr.select(active, share, 0)
        low = dr.select(active, dr.minimum(low, theirs), low)
        high = dr.select(active, dr.maximum(high, theirs), high)
    color = dr.select(weight > 0.5, dr.clip(total / weight, low, high), nearest.color)
    frames = dr.select(between, dr.minimum(nearest.frames, MOVING), nearest.frames)
    return replace(nearest, color=color, frames=frames)


def _spline(distance: mi.Float) -> mi.Float:
    """Weight of a sample at a distance [pixels]."""
    t = dr.abs(distance)
    near = 1 + t * t * (1.5 * t - 2.5)
    far = 2 + t * (-4 + t * (2.5 - 0.5 * t))
    return dr.select(t < 1, near, dr.select(t < 2, far, 0))


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
    color = dr.lerp(before.color, mean, 2 / (frames + 1))
    after = replace(before, color=color, frames=frames)
    # A mean that is not finite would stay for ever.
    return dr.select(dr.all(dr.isfinite(after.color)), after, before)


def aimed(
    grid: Grid, before: ColorHistory, shown: mi.Color3f, mean: mi.Color3f, alike: mi.UInt32
) -> ColorHistory:
    """The colour history with what selection has added to this frame.

    An integral controller: what is shown is, on the average over frames, as bright as the plain
    average, whatever bias the choice has, because the excess goes on growing until it is. From
    frame to frame it spreads over similar pixels: one pixel's is mostly noise.

    Parameters
    ----------
    before : ColorHistory
        With this frame in it.
    shown, mean : Color3f
        What this frame shows, and its plain average.
    alike : UInt32
        Result of :func:`.around.similar_neighbors`.
    """
    rate = 1 / dr.maximum(before.frames, FEWEST)
    excess = before.excess + (shown - mean) * rate
    excess = dr.select(dr.all(dr.isfinite(excess)), excess, before.excess)
    excess = local_mean(grid, excess, alike)
    # What cannot be reached must not be asked for more and more.
    return replace(before, excess=dr.clip(excess, -BRIGHTEST * before.color, before.color))


def smoothed(grid: Grid, colors: ColorHistory, alike: mi.UInt32, further: mi.UInt32) -> mi.Color3f:
    """The history without much of its noise: bilateral means over similar pixels, near and further.

    A neighbour of luminance b counts (min(a, b) / max(a, b))^4 beside the pixel's own a: textures,
    highlights and the edges of shadows stay, and bright spots stay where they are. It counts in
    proportion to its frames: pixels at an edge, which see one surface or the other, have few.

    Parameters
    ----------
    alike, further : UInt32
        Results of :func:`.around.similar_neighbors` and :func:`.around.similar_further`.
    """
    color = colors.color
    for step, counted in enumerate((alike, further), 1):
        color = _bilateral_mean(grid, color, colors.frames, counted, step)
    return color


def _bilateral_mean(
    grid: Grid, color: mi.Color3f, frames: mi.Float, alike: mi.UInt32, step: int
) -> mi.Color3f:
    values = side_by_side(color, frames)
    own = target(color)
    total, weight = frames * color, mi.Float(frames)
    for _, theirs, known in colors_around(grid, values, grid.pixels(), alike, step):
        bright = target(theirs)
        ratio = dr.square(dr.minimum(own, bright) / dr.maximum(own, bright))
        share = dr.select(bright > 0, dr.square(ratio) * known, 0)
        total += share * theirs
        weight += share
    return dr.select(weight > 0, total / weight, color)


def clamped(grid: Grid, before: ColorHistory, mean: mi.Color3f, alike: mi.UInt32) -> ColorHistory:
    """The history, within one standard deviation of the current frame around each pixel.

    Behind the edge of a shadow that moves, it forgets where the edge was: what is found outside
    counts as :data:`DOUBTED` frames from then on. Channel by channel, over similar pixels; the
    usual clamp of temporal antialiasing.

    Parameters
    ----------
    before : ColorHistory
        Without this frame.
    mean : Color3f
        This frame's plain average.
    alike : UInt32
        Result of :func:`.around.similar_neighbors`.
    """
    centre, square = (local_mean(grid, x, alike) for x in (mean, mean * mean))
    deviation = dr.sqrt(dr.maximum(square - centre * centre, 0))
    # From 1e19 on single precision cannot hold the squares, and the history is left as it is.
    known = dr.isfinite(square - centre * centre)
    within = dr.clip(before.color, centre - deviation, centre + deviation)
    color = dr.select(known, within, before.color)
    doubted = dr.any(color != before.color)
    frames = dr.select(doubted, dr.minimum(before.frames, DOUBTED), before.frames)
    return replace(before, color=color, frames=frames)


def brightness(
    grid: Grid, color: mi.Color3f, mean: mi.Color3f, alike: mi.UInt32, further: mi.UInt32
) -> mi.Float:
    """What makes the history as bright as the current frame around each pixel.

    Where the light changes, the history tells where it was. Multiplied by the ratio of local means
    of luminance (of similar pixels; standard deviation 2.8 pixels) it keeps its detail and takes
    the brightness of the frame; so also the frame's noise of lower frequencies.

    Parameters
    ----------
    color, mean : Color3f
        Colour history and this frame's plain average.
    alike, further : UInt32
        Results of :func:`.around.similar_neighbors` and :func:`.around.similar_further`.
    """
    both = mi.Color3f(target(color), target(mean), 0)
    for step, counted in enumerate((alike, further), 1):
        both = local_mean(grid, both, counted, step)
    before, now, _ = both
    return dr.select(before > 0, now / before, 0)
