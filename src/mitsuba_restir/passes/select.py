"""Selection: show, of the estimates that a pixel has anyway, the one that makes the error blue.

Vertical error optimisation (Chizhov et al. 2022, "Perceptual error optimization for Monte Carlo
rendering") over the pair estimators g_0 .. g_k of spatial reuse. The plain average of a pixel is
m = (g_0 + ... + g_k) / (k + 1); its candidates are m and, for every j,

    m + (m - g_j) / k     (the mean without g_j),

the means without two, and the means without one of earlier rounds of spatial reuse: convex
combinations of the g with fixed weights. Where the g have the pixel's expectation, so have they (by
rank only m has it, see :mod:`mitsuba_restir.neighbors.ranks`: g_j is from stratum j).
With errors e_q = I_q - r_q against the reference r, the energy of an image I is the error seen
through a Gaussian, sum |g_sigma * e|². Over one pixel p, the others given, it is least nearest to

    I_p = r_p + t_p,     t_p = -sum_d a(d) e_{p+d},     a(d) = exp(-|d|² / (4 sigma²)),

the sum over the 20 pixels around, as far as they are similar (beyond them a(d) is below 0.14 at
sigma 1). Each pixel is visited once, in nine sets of pixels three apart that see one another's
choices.

What the choice comes near to is the reference, error and all. It is the colour history, smoothed
where it is smooth, less the excess: a choice among values with heavy tails makes some surfaces too
bright and others too dark, and what it does is measured against the plain averages and taken back
(:func:`mitsuba_restir.neighbors.color_history.aimed`), over as many frames as the history counts.
What is left of it in a frame is much the same everywhere: :func:`as_bright` takes it out, and the
mean of the picture is that of the plain averages, frame by frame, whatever the choice does. Pixels
with a single pair, whose candidates would be its two estimates, show their mean, and so do those
whose errors are beyond 1e19, where single precision cannot hold their squares.

The choice depends on the values chosen from, so what is shown is biased. It is for display only:
nothing of it gets into reservoirs or their history.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi

from ..neighbors.around import (
    colors_around,
    side_by_side,
    similar_further,
    similar_neighbors,
    spaced_pixels,
)
from ..neighbors.color_history import (
    ColorHistory,
    aimed,
    brightness,
    clamped,
    remember,
    smoothed,
)
from ..paths.grid import Grid
from ..paths.primary_hit import PrimaryHit
from ..resampling.subsets import Round, candidates
from ..sampling.streams import FrameKey, Purpose, uniform2
from ..shifts.scope import Scope

SPACING = 3
"""Pixels of a set are so far apart, beyond each other's reach."""

BRIGHTEST = 4.5
"""What is brighter than the reference by this factor, in a channel, counts as that."""

UNLIKE = 0.1
"""Largest factor that makes the picture as bright as the plain averages, less one. Beyond it the
excess is left to later frames: a single bright estimate that is not shown must not make a flash."""


def select(
    scope: Scope,
    hit: PrimaryHit,
    rounds: list[Round],
    before: ColorHistory,
    sigma: float,
    changing: bool,
) -> tuple[mi.Color3f, ColorHistory]:
    """The colours to show, and the colour history with this frame in it.

    Parameters
    ----------
    rounds : list of Round
        Of spatial reuse, in order; without selection, the frame would show the last one's mean.
    before : ColorHistory
        At each pixel's previous place.
    sigma : float
        Standard deviation of the Gaussian through which the error is seen [pixels].
    changing : bool
        Whether lights or geometry may have changed since the last frame: the history then follows
        the brightness of the frame.
    """
    grid, mean = scope.grid, rounds[-1].mean
    alike = similar_neighbors(grid, hit)
    dr.eval(alike)
    further = similar_further(grid, alike)
    dr.eval(further)
    if changing:
        before = clamped(grid, before, mean, alike)
    colors = replace(remember(before, mean), alike=alike)
    dr.eval(colors)
    reference = dr.maximum(smoothed(grid, colors, alike, further) - colors.excess, 0)
    if changing:
        reference *= brightness(grid, reference, mean, alike, further)
    shown = choose(grid, scope.key, rounds, Aim(reference, alike, sigma))
    colors = colors if changing else aimed(grid, colors, shown, mean, alike)
    return as_bright(shown, mean), colors


def as_bright(shown: mi.Color3f, mean: mi.Color3f) -> mi.Color3f:
    """What is shown, times the factor (of each channel) that gives it the mean of the plain frame.

    The factor is held within :data:`UNLIKE` of one, and pixels that are not finite have no part in
    it.

    Parameters
    ----------
    shown, mean : Color3f
        Of all pixels: what selection has chosen, and the plain averages.
    """

    def factor(plain: mi.Float, chosen: mi.Float) -> mi.Float:
        usable = dr.isfinite(plain) & dr.isfinite(chosen)
        return dr.sum(dr.select(usable, plain, 0)) / dr.sum(dr.select(usable, chosen, 0))

    factors = [factor(plain, chosen) for plain, chosen in zip(mean, shown, strict=True)]
    bounded = (dr.clip(factor, 1 - UNLIKE, 1 + UNLIKE) for factor in factors)
    usable = zip(factors, bounded, strict=True)
    return shown * mi.Color3f(*(dr.select(dr.isfinite(f), b, 1) for f, b in usable))


@dataclass
class Aim:
    """What the choice is to come near to.

    Fields: ``reference`` (what errors are measured against), ``alike`` (result of
    :func:`mitsuba_restir.neighbors.around.similar_neighbors`), ``sigma`` (as of
    :func:`select`).
    """

    reference: mi.Color3f
    alike: mi.UInt32
    sigma: float


def choose(
    grid: Grid,
    key: FrameKey,
    rounds: list[Round],
    aim: Aim,
) -> mi.Color3f:
    """One of each pixel's candidates.

    Parameters
    ----------
    key : FrameKey
        Draws the order of the sets.
    rounds : list of Round
        See :func:`select`.
    """
    reference, mean = aim.reference, rounds[-1].mean
    dr.eval(aim)
    error = side_by_side(bounded(mean, reference) - reference, mi.Float(0))
    shown = dr.copy(mean)
    dr.eval(shown)

    order = uniform2(key.stream(Purpose.SELECTION, 0), 0, 0)
    dr.eval(order)
    for index in range(SPACING**2):
        number = set_in_turn(dr.opaque(mi.UInt32, index), order)
        pixel, inside = spaced_pixels(grid, SPACING, number)
        best, left = best_candidate(grid, rounds, aim, error, pixel, inside)
        # Evaluated, and all between forgotten with the function: what still referred to the errors
        # would make Dr.Jit copy them before they are changed.
        dr.eval(pixel, inside, best, left)
        dr.scatter(shown, best, pixel, inside)
        dr.scatter(error, mi.Vector4f(left.x, left.y, left.z, 0), pixel, inside)
        dr.eval(shown, error)
    return shown


def best_candidate(
    grid: Grid,
    rounds: list[Round],
    aim: Aim,
    error: mi.Float,
    pixel: mi.UInt32,
    inside: mi.Bool,
) -> tuple[mi.Color3f, mi.Color3f]:
    """The candidates of some pixels that are nearest to what cancels their neighbours' errors.

    Parameters
    ----------
    error : Float
        Of all pixels, as they stand, from :func:`mitsuba_restir.neighbors.around.side_by_side`.
    pixel, inside : UInt32, Bool
        The pixels, and whether they lie in the image.

    Returns
    -------
    best, left : Color3f
        What to show, and its error.
    """
    around = dr.gather(mi.UInt32, aim.alike, pixel, inside)
    expected = dr.gather(mi.Color3f, aim.reference, pixel, inside)
    wanted = expected - neighbors_error(grid, error, around, pixel, aim.sigma)
    own = [dr.gather(Round, shared, pixel, inside) for shared in rounds]
    best = own[-1].mean
    distance = dr.squared_norm(bounded(best, expected) - wanted)
    for color, valid in candidates(own):
        its_distance = dr.squared_norm(bounded(color, expected) - wanted)
        better = valid & (its_distance < distance)
        best = dr.select(better, color, best)
        distance = dr.select(better, its_distance, distance)
    return best, bounded(best, expected) - expected


def bounded(color: mi.Color3f, reference: mi.Color3f) -> mi.Color3f:
    """What a colour counts as, see :data:`BRIGHTEST`."""
    return dr.minimum(color, BRIGHTEST * reference)


def neighbors_error(
    grid: Grid, error: mi.Float, alike: mi.UInt32, pixel: mi.UInt32, sigma: float
) -> mi.Color3f:
    """sum a(d) e_{p+d} over the similar neighbours of each pixel.

    Parameters
    ----------
    error : Float
        Of all pixels, from :func:`mitsuba_restir.neighbors.around.side_by_side`.
    alike : UInt32
        Which neighbours count, of the pixels that ``pixel`` names.
    sigma : float
        As of :func:`select`.
    """
    total = mi.Color3f(0)
    for (dx, dy), theirs, _ in colors_around(grid, error, pixel, alike):
        total += theirs * math.exp(-(dx**2 + dy**2) / (4 * sigma**2))
    return total


def set_in_turn(index: mi.UInt32, order: tuple[mi.Float, mi.Float]) -> mi.UInt32:
    """Number of the set whose turn it is.

    The sets take turns in an order that changes from frame to frame, or the same pixels would
    always choose first.

    Parameters
    ----------
    index : UInt32
        Number of the turn, below ``SPACING**2``.
    order : (Float, Float)
        Two uniform random numbers. They choose one of the 54 orders i -> (factor i + first) mod 9.
    """
    sets = SPACING**2
    first, choice = mi.UInt32(order[0] * sets), mi.UInt32(order[1] * (sets - SPACING))
    # 1, 2, 4, 5, 7, 8: the factors that have no divisor in common with the number of sets.
    factor = choice + choice // (SPACING - 1) + 1
    return (factor * index + first) % sets
