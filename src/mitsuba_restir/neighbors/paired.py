"""Neighbours in reciprocal pairs: the shift of q's path to p serves both p and q."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from ..paths.grid import Grid
from ..resampling.pairwise import Pulled, Sharing, canonical_share, pull
from ..resampling.reservoir import Reservoir
from ..sampling.pairing import PairingTile, partner_offset
from ..sampling.streams import Stream
from .exchange import Exchange, for_each_neighbor
from .similarity import similar


def paired(sharing: Sharing, tile: PairingTile, reservoirs: Reservoir, choices: Stream) -> Exchange:
    """Exchange paths in pairs, see :mod:`mitsuba_restir.sampling.pairing`."""
    hits = sharing.hits

    def pull_partner(number: mi.UInt32) -> Pulled:
        other, inside = partner(sharing.scope.grid, tile, choices, number)
        there = hits.at(other, inside)
        # Similarity need not be symmetric: each side's own test decides whether it reuses the
        # other.
        valid = inside & similar(hits, there)
        return pull(sharing, reservoirs, other, valid, inside & similar(there, hits))

    pulled = for_each_neighbor(pull_partner, sharing.neighbors)
    shares, confidence = [], mi.Float(reservoirs.confidence)
    for theirs in pulled:
        shares.append(_mutual_share(sharing, reservoirs, theirs))
        confidence += dr.gather(mi.Float, reservoirs.confidence, theirs.source, theirs.valid)
    return Exchange(pulled, shares, confidence, [theirs.outcome for theirs in pulled])


def partner(
    grid: Grid, tile: PairingTile, choices: Stream, index: mi.UInt32
) -> tuple[mi.UInt32, mi.Bool]:
    """Every pixel's partner in the ``index``-th pairing.

    Returns
    -------
    other : UInt32
        Index of the partner (the pixel itself where there is none).
    inside : Bool
        Whether there is a partner and it lies in the image.
    """
    pixel = grid.pixels()
    along, across = partner_offset(tile, choices, index, *grid.place(pixel))
    other, inside = grid.look(pixel, along, across)
    return other, inside & ((along != 0) | (across != 0))


def _mutual_share(sharing: Sharing, reservoirs: Reservoir, theirs: Pulled) -> mi.Float:
    reach = dr.gather(mi.Float, theirs.reach, theirs.source, theirs.valid)
    return dr.select(theirs.valid, canonical_share(sharing, reservoirs, reach), 0)
