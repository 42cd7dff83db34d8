"""Neighbours by rank in groups of scattered pixels: picks go round, and follow a mask.

A pixel takes the path of one, and its own sample is weighed against another, the one that takes its
path. Given all paths, both are each pixel of the class with the same expectation, and the halves of
the estimators

    (1/k) sum_j m_{s_j} F(y_{s_j}) W J   and   (1/k) sum_j m_{c,t_j} F(x) W

add up to an unbiased one, because m_q + m_{c,q} = 1 for every q. See :mod:`.ranks` for the ranks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import drjit as dr
import mitsuba as mi

from ..paths.spectrum import target
from ..resampling.pairwise import Pulled, Sharing, canonical_share, pull
from ..resampling.reservoir import Reservoir
from ..sampling.dither import mask_texture
from ..sampling.masks import load_mask
from ..sampling.streams import Stream
from .exchange import Exchange, for_each_neighbor
from .groups import Groups, scattered_groups, surface_labels
from .ranks import Ranks, rank_pixels

BLOCK = 16
"""Side of the blocks of adjacent pixels that the groups of ``blocks`` are."""


def scattered(mask: str) -> Callable[[float], Groups]:
    """Layout of scattered groups, by the mask of a name."""
    return lambda radius: scattered_groups(mask_texture(load_mask(mask)), radius)


def adjacent(radius: float) -> Groups:
    """Layout of blocks of adjacent pixels, whatever the radius."""
    return Groups(mask_texture(load_mask("white")), BLOCK, 1)


def ranked(sharing: Sharing, groups: Groups, reservoirs: Reservoir, choices: Stream) -> Exchange:
    """Exchange paths by rank in groups."""
    grid = sharing.scope.grid
    labels = surface_labels(sharing.hits, choices)
    values = target(reservoirs.color) * reservoirs.weight
    dr.eval(labels, values)
    ranks = rank_pixels(grid, groups, labels, values, reservoirs.confidence, choices)
    dr.eval(ranks)
    pixel = grid.pixels()
    shared = ranks.count > 1

    def pull_source(number: mi.UInt32) -> Pulled:
        source = ranks.source(number, sharing.neighbors)
        # A pixel that meets itself has g_i = g_0, and needs no shift.
        other = shared & (source != pixel)
        return replace(pull(sharing, reservoirs, source, other, other), valid=shared)

    pulled = for_each_neighbor(pull_source, sharing.neighbors)
    shares = _circulating_shares(sharing, reservoirs, ranks, pulled)
    confidence = expected_confidence(reservoirs.confidence, ranks, sharing.neighbors)
    return Exchange(pulled, shares, confidence, [theirs.outcome for theirs in pulled])


def expected_confidence(own: mi.Float, ranks: Ranks, neighbors: int) -> mi.Float:
    """Confidence of every pixel and, in expectation, of its picks.

    The picks' own would go with their ranks, and so with what the merged reservoir holds.
    """
    others = (ranks.confidence - own) * (neighbors / dr.maximum(mi.Float(ranks.count), 1))
    return own + dr.select(ranks.count > 1, others, 0)


def _circulating_shares(
    sharing: Sharing, reservoirs: Reservoir, ranks: Ranks, pulled: list[Pulled]
) -> list[mi.Float]:
    """Weights of the canonical sample against the pixels that take its path."""
    grid = sharing.scope.grid
    pixel = grid.pixels()
    shared = ranks.count > 1
    reaches = dr.concat([theirs.reach for theirs in pulled])
    shares = []
    for t in range(sharing.neighbors):
        taker, j = ranks.taker(t, sharing.neighbors)
        entry = j * grid.size + taker
        reach = dr.gather(mi.Float, reaches, entry, shared & (taker != pixel))
        shares.append(dr.select(shared, canonical_share(sharing, reservoirs, reach), 0))
    return shares
