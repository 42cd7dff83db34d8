"""Selection: show, of the estimates that a pixel has anyway, the one that makes the error blue.

Vertical error optimisation (Chizhov et al. 2022, "Perceptual error optimization for Monte Carlo
rendering") over the pair estimators g_0 .. g_k of spatial reuse. The plain average of a pixel is
m = (g_0 + ... + g_k) / (k + 1); its candidates are m and, for every j,

    m + (m - g_j) / k     (the mean without g_j)  and its mirror image     m - (m - g_j) / k,

convex combinations of the g with fixed weights. Where the g have the pixel's expectation, so have
they (by rank only m has it, see :mod:`mitsuba_restir.passes.ranks`: g_j is from stratum j). With
errors e_q = I_q - r_q against the colour history r, the energy of an image I is the error seen
through a Gaussian, sum |g_sigma * e|². Over one pixel p, the others given, it is least nearest to

    I_p = r_p + t_p,     t_p = -sum_d a(d) e_{p+d},     a(d) = exp(-|d|² / (4 sigma²)),

the sum over the 20 pixels around, as far as they are similar (beyond them a(d) is below 0.14). Each
pixel is visited once, in nine sets of pixels three apart that see one another's choices.

Ours are the mirror images and the bound: a choice that avoids outliers darkens the image, because
outliers are bright. With mirror images it can go either way, and errors of more than :data:`LIMIT`
times the history around are taken for that, on either side. Pixels with a single pair, whose
candidates would be its two estimates, show their mean.

The choice depends on the values chosen from, so what is shown is biased. It is for display only:
nothing of it gets into reservoirs or history.
"""

from __future__ import annotations

import math
from typing import Any

import drjit as dr
import mitsuba as mi

from ..sampling.streams import SELECTION, pass_stream, uniform2
from .neighborhood import (
    ADJACENT,
    OFFSETS,
    counts,
    local_mean,
    moved,
    pixels_of_set,
    set_lanes,
)
from .spatial import PairEstimators

SIGMA = 1.0
"""Standard deviation of the Gaussian through which the error is seen [pixels]."""

SPACING = 3
"""Pixels of a set are so far apart, beyond each other's reach."""

LIMIT = 3.5
"""Largest error that counts, channel by channel, relative to the mean of the history in 3x3 pixels.
Where estimates have heavy tails, half of it makes the image too bright, twice of it too dark; with
it the sign depends on the tail (gamma-distributed ones: -2 to +4 %)."""


def select(
    mean: Any,
    estimators: PairEstimators,
    reference: Any,
    alike: Any,
    size: tuple[int, int],
    sample: Any,
    seed: Any,
) -> Any:
    """The colours to show.

    Parameters
    ----------
    mean : Color3f
        Plain average of the pair estimators.
    estimators : PairEstimators
        The pair estimators.
    reference : Color3f
        Colour history.
    alike : UInt32
        Result of :func:`.neighborhood.similar_neighbors`.
    size : (int, int)
        Width and height in pixels.
    sample, seed : UInt32
        The frame's running number and the user's seed; they draw the order of the sets.

    Returns
    -------
    Color3f
        One of each pixel's candidates.
    """
    width, height = (dr.opaque(mi.UInt32, n) for n in size)
    limit = LIMIT * local_mean(reference, alike & ADJACENT, width)
    error = bounded(mean - reference, limit)
    shown = dr.copy(mean)
    dr.eval(alike, limit, error, shown)

    order = uniform2(pass_stream(SELECTION, 0, sample, seed), 0, 0)
    lanes = set_lanes(size, SPACING)
    for index in range(SPACING**2):
        number = set_in_turn(dr.opaque(mi.UInt32, index), order)
        pixel, inside = pixels_of_set(number, SPACING, lanes, width, height)
        own_limit = dr.gather(mi.Color3f, limit, pixel, inside)
        expected = dr.gather(mi.Color3f, reference, pixel, inside)
        around = dr.gather(mi.UInt32, alike, pixel, inside)
        wanted = -neighbors_error(error, around, pixel, width)
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


def candidates(estimators: PairEstimators, mean: Any) -> list[tuple[Any, Any]]:
    """A pixel's candidates beside the mean: ``(Color3f, Bool)``, whether it has this one."""
    pairs = sum(dr.select(valid, mi.Float(1), 0) for valid in estimators.valid[1:])
    found = []
    for color, valid in zip(estimators.colors, estimators.valid, strict=True):
        step = (mean - color) / dr.maximum(pairs, 1)
        found += [(mean + step, valid & (pairs > 1)), (mean - step, valid & (pairs > 1))]
    return found


def bounded(error: Any, limit: Any) -> Any:
    """An error, channel by channel within +-``limit``."""
    return dr.clip(error, -limit, limit)


def neighbors_error(error: Any, alike: Any, pixel: Any, width: Any) -> Any:
    """sum a(d) e_{p+d} over the similar neighbours of each pixel (``Color3f``).

    Parameters
    ----------
    error : Color3f
        Of all pixels.
    alike : UInt32
        Which neighbours count, of the pixels that ``pixel`` names.
    """
    total = mi.Color3f(0)
    for i, (dx, dy) in enumerate(OFFSETS):
        seen = dr.gather(mi.Color3f, error, moved(pixel, (dx, dy), width), counts(alike, i))
        total += seen * math.exp(-(dx**2 + dy**2) / (4 * SIGMA**2))
    return total


def set_in_turn(index: Any, order: tuple[Any, Any]) -> Any:
    """Number of the set whose turn it is (``UInt32``).

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
