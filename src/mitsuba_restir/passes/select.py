"""Selection: show, of the estimates that a pixel has anyway, the one that makes the error blue.

Vertical error optimisation (Chizhov et al. 2022, "Perceptual error optimization for Monte Carlo
rendering") over the pair estimators g_0 .. g_k of spatial reuse. The plain average of a pixel is
m = (g_0 + ... + g_k) / (k + 1); its candidates are m and, for every j,

    m + (m - g_j) / k     (the mean without g_j)  and its mirror image     m - (m - g_j) / k,

convex combinations of the g with fixed weights. Where the g have the pixel's expectation, so have
they (by rank only m has it, see :mod:`mitsuba_restir.neighbors.ranks`: g_j is from stratum j). With
errors e_q = I_q - r_q against the colour history r, the energy of an image I is the error seen
through a Gaussian, sum |g_sigma * e|². Over one pixel p, the others given, it is least nearest to

    I_p = r_p + t_p,     t_p = -sum_d a(d) e_{p+d},     a(d) = exp(-|d|² / (4 sigma²)),

the sum over the 20 pixels around, as far as they are similar (beyond them a(d) is below 0.14). Each
pixel is visited once, in nine sets of pixels three apart that see one another's choices.

Ours are the mirror images and the bound: a choice that avoids outliers darkens the image, because
outliers are bright. With mirror images it can go either way, and errors of more than :data:`LIMIT`
times the history around are taken for that, on either side. Pixels with a single pair, whose
candidates would be its two estimates, show their mean, and so do those whose errors are beyond
1e19, where single precision cannot hold their squares.

The choice depends on the values chosen from, so what is shown is biased. It is for display only:
nothing of it gets into reservoirs or history.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations

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
from ..resampling.pairwise import PairEstimators
from ..sampling.streams import FrameKey, Purpose, uniform2
from ..shifts.scope import Scope

SIGMA = 1.0
"""Standard deviation of the Gaussian through which the error is seen [pixels]."""

SPACING = 3
"""Pixels of a set are so far apart, beyond each other's reach."""

LIMIT = 3.5
"""Largest error that counts, channel by channel, relative to the mean of the history in 3x3 pixels.
Where estimates have heavy tails, half of it makes the image too bright, twice of it too dark; with
it the sign depends on the tail (gamma-distributed ones: -2 to +4 %)."""


MOST_PAIRED = 8
"""Up to so many estimates there are means without pairs, which are as many as pairs."""


def select(
    scope: Scope,
    hit: PrimaryHit,
    mean: mi.Color3f,
    estimators: PairEstimators,
    before: ColorHistory,
    changing: bool,
) -> tuple[mi.Color3f, ColorHistory]:
    """The colours to show, and the colour history with this frame in it.

    Parameters
    ----------
    mean : Color3f
        Plain average of the pair estimators.
    before : ColorHistory
        At each pixel's previous place.
    changing : bool
        Whether lights or geometry may have changed since the last frame: the history then follows
        the brightness of the frame.
    """
    grid = scope.grid
    alike, further = similar_neighbors(grid, hit), similar_neighbors(grid, hit, step=2)
    dr.eval(alike, further)
    if changing:
        before = replace(before, color=clamped(grid, before.color, mean, alike))
    colors = replace(remember(before, mean), alike=alike)
    dr.eval(colors)
    reference = wanted_color(grid, colors, alike, further)
    if changing:
        reference *= brightness(grid, colors.color, mean, alike, further)
    shown = choose(grid, scope.key, mean, estimators, reference, alike)
    return shown, colors if changing else aimed(colors, shown, mean)


def wanted_color(
    grid: Grid, colors: ColorHistory, alike: mi.UInt32, further: mi.UInt32
) -> mi.Color3f:
    """What errors are measured against: the colour history, smoothed, less the excess.

    Parameters
    ----------
    alike, further : UInt32
        Results of :func:`mitsuba_restir.neighbors.around.similar_neighbors` at step 1 and 2.
    """
    color = dr.maximum(colors.color - colors.excess, 0)
    return smoothed(grid, smoothed(grid, color, alike), further, step=2)


def choose(
    grid: Grid,
    key: FrameKey,
    mean: mi.Color3f,
    estimators: PairEstimators,
    reference: mi.Color3f,
    alike: mi.UInt32,
) -> mi.Color3f:
    """One of each pixel's candidates.

    Parameters
    ----------
    key : FrameKey
        Draws the order of the sets.
    mean : Color3f
        Plain average of the pair estimators.
    reference : Color3f
        Colour history.
    alike : UInt32
        Result of :func:`mitsuba_restir.neighbors.around.similar_neighbors`.
    """
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
        wanted = -neighbors_error(grid, error, around, pixel)
        own_mean = dr.gather(mi.Color3f, mean, pixel, inside)
        own = dr.gather(PairEstimators, estimators, pixel, inside)
        best = own_mean
        best_error = bounded(own_mean - expected, own_limit)
        best_distance = dr.squared_norm(best_error - wanted)
        for color, valid in candidates(own, own_mean):
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


def candidates(estimators: PairEstimators, mean: mi.Color3f) -> list[tuple[mi.Color3f, mi.Bool]]:
    """A pixel's candidates beside the mean, and whether it has this one."""
    colors, valid = estimators.colors, estimators.valid
    count = sum((dr.select(used, mi.Float(1), 0) for used in valid), mi.Float(0))
    found = []
    for i, color in enumerate(colors):
        others = total(colors, (i,))
        usable = valid[i] & (count > 2)
        # The sum of the others, not m + (m - g) / k: its rounding can be below zero.
        without = others / dr.maximum(count - 1, 1)
        mirrored = mean - (mean - color) / dr.maximum(count - 1, 1)
        found += [(without, usable), (mirrored, usable)]
    if len(colors) <= MOST_PAIRED:
        for i, j in combinations(range(len(colors)), 2):
            others = total(colors, (i, j))
            usable = valid[i] & valid[j] & (count > 3)
            found.append((others / dr.maximum(count - 2, 1), usable))
            if len(colors) > 4:  # of four, it is the mean without the other two
                both = 2 * (colors[i] + colors[j])
                rest = (count - 4) / dr.maximum(count - 2, 1) * others
                found.append(((both + rest) / count, usable))
    return found


def total(colors: list[mi.Color3f], left_out: tuple[int, ...]) -> mi.Color3f:
    """Sum of all colours but some."""
    kept = (color for i, color in enumerate(colors) if i not in left_out)
    return sum(kept, mi.Color3f(0))


def bounded(error: mi.Color3f, limit: mi.Color3f) -> mi.Color3f:
    """An error, channel by channel within +-``limit``."""
    return dr.clip(error, -limit, limit)


def neighbors_error(
    grid: Grid, error: mi.Color3f, alike: mi.UInt32, pixel: mi.UInt32
) -> mi.Color3f:
    """sum a(d) e_{p+d} over the similar neighbours of each pixel.

    Parameters
    ----------
    error : Color3f
        Of all pixels.
    alike : UInt32
        Which neighbours count, of the pixels that ``pixel`` names.
    """
    total = mi.Color3f(0)
    for i, (dx, dy) in enumerate(OFFSETS):
        seen = dr.gather(mi.Color3f, error, grid.beside(pixel, (dx, dy)), counts(alike, i))
        total += seen * math.exp(-(dx**2 + dy**2) / (4 * SIGMA**2))
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
