"""Selection: show, of the estimates that a pixel has anyway, the one that makes the error blue.

Vertical error optimisation (Chizhov et al. 2022, "Perceptual error optimization for Monte Carlo
rendering") over the pair estimators g_0 .. g_k of spatial reuse. The plain average of a pixel is
m = (g_0 + ... + g_k) / (k + 1); its candidates are m and, for every j,

    m + (m - g_j) / k     (the mean without g_j)  and its mirror image     m - (m - g_j) / k,

the same for the means without two, and for the means without one of earlier rounds of spatial
reuse: convex combinations of the g with fixed weights. Where the g have the pixel's expectation, so
have they (by rank only m has it, see :mod:`mitsuba_restir.neighbors.ranks`: g_j is from stratum j).
With errors e_q = I_q - r_q against the reference r, the energy of an image I is the error seen
through a Gaussian, sum |g_sigma * e|². Over one pixel p, the others given, it is least nearest to

    I_p = r_p + t_p,     t_p = -sum_d a(d) e_{p+d},     a(d) = exp(-|d|² / (4 sigma²)),

the sum over the 20 pixels around, as far as they are similar (beyond them a(d) is below 0.14 at
sigma 1). Each pixel is visited once, in nine sets of pixels three apart that see one another's
choices.

What the choice comes near to is the reference, error and all. It is the colour history, smoothed
where it is smooth, less the excess: a choice among values with heavy tails makes the image too
bright or too dark, and what it does is measured against the plain averages and taken back
(:func:`mitsuba_restir.neighbors.color_history.aimed`). Errors of more than :data:`LIMIT` times the
reference around are taken for that, on either side, so that a bright spot has no dark halo. Pixels
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
    ADJACENT,
    OFFSETS,
    counts,
    local_mean,
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

LIMIT = 3.5
"""Largest error that counts, channel by channel, relative to the reference's mean in 3x3 pixels."""


@dataclass(frozen=True)
class Seen:
    """How frames are seen.

    Attributes
    ----------
    sigma : float
        Standard deviation of the Gaussian through which the error is seen [pixels].
    changing : bool
        Whether lights or geometry may have changed since the last frame: the history then follows
        the brightness of the frame.
    """

    sigma: float
    changing: bool


def select(
    scope: Scope,
    hit: PrimaryHit,
    rounds: list[Round],
    before: ColorHistory,
    seen: Seen,
) -> tuple[mi.Color3f, ColorHistory]:
    """The colours to show, and the colour history with this frame in it.

    Parameters
    ----------
    rounds : list of Round
        Of spatial reuse, in order; without selection, the frame would show the last one's mean.
    before : ColorHistory
        At each pixel's previous place.
    """
    grid, mean = scope.grid, rounds[-1].mean
    alike, further = similar_neighbors(grid, hit), similar_neighbors(grid, hit, step=2)
    dr.eval(alike, further)
    if seen.changing:
        before = clamped(grid, before, mean, alike)
    colors = replace(remember(before, mean), alike=alike)
    dr.eval(colors)
    reference = dr.maximum(smoothed(grid, colors, alike, further) - colors.excess, 0)
    if seen.changing:
        reference *= brightness(grid, reference, mean, alike, further)
    aim = Aim(reference, alike, seen.sigma)
    shown = choose(grid, scope.key, rounds, aim)
    return shown, colors if seen.changing else aimed(grid, colors, shown, mean, alike)


@dataclass
class Aim:
    """What the choice is to come near to.

    Fields: ``reference`` (what errors are measured against), ``alike`` (result of
    :func:`mitsuba_restir.neighbors.around.similar_neighbors`), ``sigma`` (see :class:`Seen`).
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
    reference, alike, mean = aim.reference, aim.alike, rounds[-1].mean
    limit = LIMIT * local_mean(grid, reference, alike & ADJACENT)
    error = bounded(mean - reference, limit)
    shown = dr.copy(mean)
    dr.eval(alike, limit, error, shown)

    order = uniform2(key.stream(Purpose.SELECTION, 0), 0, 0)
    for index in range(SPACING**2):
        number = set_in_turn(dr.opaque(mi.UInt32, index), order)
        pixel, inside = spaced_pixels(grid, SPACING, number)
        own_limit = dr.gather(mi.Color3f, limit, pixel, inside)
        expected = dr.gather(mi.Color3f, reference, pixel, inside)
        around = dr.gather(mi.UInt32, alike, pixel, inside)
        wanted = -neighbors_error(grid, error, around, pixel, aim.sigma)
        own = [dr.gather(Round, shared, pixel, inside) for shared in rounds]
        best = own[-1].mean
        best_error = bounded(best - expected, own_limit)
        best_distance = dr.squared_norm(best_error - wanted)
        for color, valid in candidates(own):
            its_error = bounded(color - expected, own_limit)
            distance = dr.squared_norm(its_error - wanted)
            better = valid & (distance < best_distance)
            best = dr.select(better, color, best)
            best_error = dr.select(better, its_error, best_error)
            best_distance = dr.select(better, distance, best_distance)
        dr.scatter(shown, best, pixel, inside)
        dr.scatter(error, best_error, pixel, inside)
        dr.eval(shown, error)
    return shown


def bounded(error: mi.Color3f, limit: mi.Color3f) -> mi.Color3f:
    """An error, channel by channel within +-``limit``."""
    return dr.clip(error, -limit, limit)


def neighbors_error(
    grid: Grid, error: mi.Color3f, alike: mi.UInt32, pixel: mi.UInt32, sigma: float
) -> mi.Color3f:
    """sum a(d) e_{p+d} over the similar neighbours of each pixel.

    Parameters
    ----------
    error : Color3f
        Of all pixels.
    alike : UInt32
        Which neighbours count, of the pixels that ``pixel`` names.
    sigma : float
        See :class:`Seen`.
    """
    total = mi.Color3f(0)
    for i, (dx, dy) in enumerate(OFFSETS):
        seen = dr.gather(mi.Color3f, error, grid.beside(pixel, (dx, dy)), counts(alike, i))
        total += seen * math.exp(-(dx**2 + dy**2) / (4 * sigma**2))
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
