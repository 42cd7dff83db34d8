"""Means of some of a pixel's estimates: what selection chooses from.

The mean without estimate j, m + (m - g_j) / k, and its mirror image m - (m - g_j) / k are convex
combinations of the k + 1 estimates with fixed weights, and so are those without two. The mirror
images let a choice go either way where one bright estimate is among dark ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import drjit as dr
import mitsuba as mi

from .pairwise import PairEstimators

MOST_PAIRED = 8
"""Up to so many estimates there are means without pairs, which are as many as pairs."""


@dataclass
class Round:
    """What a round of spatial reuse has to show.

    Fields: ``mean`` (plain average of the pair estimators), ``estimators``.
    """

    mean: mi.Color3f
    estimators: PairEstimators


def candidates(rounds: list[Round]) -> list[tuple[mi.Color3f, mi.Bool]]:
    """A pixel's candidates beside the last round's mean, and whether it has this one."""
    *earlier, last = rounds
    found = [candidate for past in earlier for candidate in without_one(past)]
    return [*found, *without_one(last), *without_two(last)]


def without_one(shared: Round) -> list[tuple[mi.Color3f, mi.Bool]]:
    """The means without each estimate, and their mirror images."""
    colors, mean, count = shared.estimators.colors, shared.mean, number(shared.estimators)
    found = []
    for i, (color, valid) in enumerate(zip(colors, shared.estimators.valid, strict=True)):
        usable = valid & (count > 2)
        # The sum of the others, not m + (m - g) / k: its rounding can be below zero.
        without = total(colors, (i,)) / dr.maximum(count - 1, 1)
        mirrored = mean - (mean - color) / dr.maximum(count - 1, 1)
        found += [(without, usable), (mirrored, usable)]
    return found


def without_two(shared: Round) -> list[tuple[mi.Color3f, mi.Bool]]:
    """The means without each pair of estimates, and their mirror images."""
    colors, valid, count = (
        shared.estimators.colors,
        shared.estimators.valid,
        number(shared.estimators),
    )
    found = []
    for i, j in combinations(range(len(colors) if len(colors) <= MOST_PAIRED else 0), 2):
        usable = valid[i] & valid[j] & (count > 3)
        others = total(colors, (i, j)) / dr.maximum(count - 2, 1)
        found.append((others, usable))
        if len(colors) > 4:  # of four, it is the mean without the other two
            both = 2 * (colors[i] + colors[j])
            found.append(((both + (count - 4) * others) / count, usable))
    return found


def number(estimators: PairEstimators) -> mi.Float:
    """How many estimates each pixel has."""
    return sum((dr.select(used, mi.Float(1), 0) for used in estimators.valid), mi.Float(0))


def total(colors: list[mi.Color3f], left_out: tuple[int, ...]) -> mi.Color3f:
    """Sum of all colours but some."""
    kept = (color for i, color in enumerate(colors) if i not in left_out)
    return sum(kept, mi.Color3f(0))
