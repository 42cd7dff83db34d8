r"""What the preview of a still aims at: the mean so far, smoothed as far as its noise says.

With M the mean of n frames, L its luminance and v the variance of L (of the frames, over n; of one
frame, that of L over similar pixels), local means of v tell how much of a difference between pixels
may be noise. Three passes, h = 1, 2 and 4 pixels apart, each go from A (at first M) to

    A' = Σ w_q A_q / Σ w_q,    w_q = exp(-(g_p - g_q)² / (9 v_h)) exp(-(l_p - l_q)² / (25 v)),

over similar pixels q, with l the luminance of A: in the first pass two pixels differ if their
surroundings do (g is the local mean of l, v_h = v / 6), or they themselves by much more; later,
when l knows its surroundings, g is l and v_h is v, and both factors are of one difference. A
histogram of frames with heavy tails is no obstacle, as it is for weights of brightness alone.

What smoothing took that was no noise shows in local means: where D = mean(L(M) - L(A')) is larger
than noise makes it, with the mean of 21 pixels that know as much as 13 independent ones,

    A <- A + (A' - A) min(1, (u² / 13) / mean(D²)),

u the mean of the pixels' standard errors (for one frame, u² = v): one bright pixel has most of v,
and would excuse what is taken from all around it.

With v in the place of u² more is smoothed, and what previews gain where light is smooth is lost
where it is not; bilateral means by brightness alone do nothing for frames of one tree. What is
gained by this aim is in docs/blue_noise.md, with the command that measures it.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from ..neighbors.around import colors_around, local_mean, side_by_side, similar_further
from ..paths.grid import Grid
from ..paths.spectrum import target

UNLIKE, OWN = 3.0, 5.0
"""Standard deviations that surroundings, and pixels, differ by where they count 1/e."""

SURROUNDINGS = 6
"""Independent pixels that know as much as a local mean, where neighbours are compared."""

KNOWN = 13
"""The same, where it is judged whether smoothing took more than noise."""

BLACK = 1e-30
"""What tells black neighbours from none."""


def aim(
    grid: Grid, mean: mi.Color3f, deviation: mi.Color3f, frames: mi.Float, alike: mi.UInt32
) -> mi.Color3f:
    """The mean so far without much of its noise.

    Parameters
    ----------
    deviation : Color3f
        Its standard error by its frames; whatever it is, where there is only one.
    frames : Float
        How many there are (opaque).
    alike : UInt32
        Result of :func:`mitsuba_restir.neighbors.around.similar_neighbors`, without the pixels
        whose mean or standard error is not finite: they would spread.
    """
    further = similar_further(grid, alike)
    dr.eval(further)
    furthest = similar_further(grid, further, 2)
    dr.eval(furthest)
    noise, usual = _noise(grid, mean, target(deviation), frames, (alike, further))
    dr.eval(noise, usual)
    result = mean
    for i, counted in enumerate((alike, further, furthest)):
        own = target(result)
        guide, level = own, noise
        if i == 0:
            guide, level = _mean(grid, own, alike), noise / SURROUNDINGS
        smooth = _smoothed(grid, result, (guide, level, noise), counted, 2**i)
        dr.eval(smooth)
        taken = dr.square(_mean(grid, target(mean) - target(smooth), alike))
        change = _mean(grid, taken, alike)
        result = dr.lerp(result, smooth, dr.minimum(1, _ratio(usual / KNOWN, change)))
        dr.eval(result)
    return result


def _noise(
    grid: Grid,
    mean: mi.Color3f,
    deviation: mi.Float,
    frames: mi.Float,
    counted: tuple[mi.UInt32, mi.UInt32],
) -> tuple[mi.Float, mi.Float]:
    """Variance of the luminance around each pixel, and the square of its usual deviation."""
    alike, further = counted
    luminance = target(mean)
    first, second, _ = local_mean(grid, mi.Color3f(luminance, dr.square(luminance), 0), alike)
    spread = dr.maximum(second - dr.square(first), 0)
    known, usual, _ = local_mean(grid, mi.Color3f(dr.square(deviation), deviation, 0), alike)
    several = frames > 1
    around = mi.Color3f(dr.select(several, known, spread), usual, 0)
    dr.eval(around)
    variance, usual, _ = local_mean(grid, around, further, 2)
    return variance, dr.select(several, dr.square(usual), variance)


def _smoothed(
    grid: Grid,
    color: mi.Color3f,
    compared: tuple[mi.Float, mi.Float, mi.Float],
    counted: mi.UInt32,
    step: int,
) -> mi.Color3f:
    """One pass; compared are guide, its variance, and that of the luminance."""
    guide, level, noise = compared
    own = target(color)
    values = side_by_side(color, dr.maximum(guide, BLACK))
    total, weight = mi.Color3f(color), mi.Float(1)
    for _, theirs, around in colors_around(grid, values, grid.pixels(), counted, step):
        unlike = _ratio(dr.square(around - guide), UNLIKE**2 * level)
        unlike += _ratio(dr.square(target(theirs) - own), OWN**2 * noise)
        share = dr.select(around > 0, dr.exp(-unlike), 0)
        total += dr.select(around > 0, share * theirs, 0)
        weight += share
    return total / weight


def _mean(grid: Grid, values: mi.Float, counted: mi.UInt32, step: int = 1) -> mi.Float:
    return local_mean(grid, mi.Color3f(values, 0, 0), counted, step).x


def _ratio(above: mi.Float, below: mi.Float) -> mi.Float:
    """Quotient of two numbers that are not negative; 0 where the first is."""
    return dr.select(above == 0, 0, above / below)
