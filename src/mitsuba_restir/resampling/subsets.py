"""Means of some of a pixel's estimates: what selection chooses from.

The mean without estimate j, m + (m - g_j) / k, is a convex combination of the k + 1 estimates with
fixed weights, and so is that without two.
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
    """The means without each estimate."""
    colors, valid, count = _estimates(shared)
    found = []
    for i, used in enumerate(valid):
        # The sum of the others, not m + (m - g) / k: its rounding can be below zero.
        others = total(colors, (i,)) / dr.maximum(count - 1, 1)
        found.append((others, used & (count > 2)))
    return found


def without_two(shared: Round) -> list[tuple[mi.Color3f, mi.Bool]]:
    """The means without each pair of estimates."""
    colors, valid, count = _estimates(shared)
    found = []
    for i, j in combinations(range(len(colors) if len(colors) <= MOST_PAIRED else 0), 2):
        others = total(colors, (i, j)) / dr.maximum(count - 2, 1)
        found.append((others, valid[i] & valid[j] & (count > 3)))
    return found


def _estimates(shared: Round) -> tuple[list[mi.Color3f], list[mi.Bool], mi.Float]:
    """Colours of the estimates, which are valid, and how many those are."""
    valid = shared.estimators.valid
    count = sum((dr.select(used, mi.Float(1), 0) for used in valid), mi.Float(0))
    return shared.estimators.colors, valid, count


def total(colors: list[mi.Color3f], left_out: tuple[int, ...]) -> mi.Color3f:
    """Sum of all colours but some."""
    kept = (color for i, color in enumerate(colors) if i not in left_out)
    return sum(kept, mi.Color3f(0))
