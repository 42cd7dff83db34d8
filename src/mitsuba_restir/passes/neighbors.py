"""Whose paths a pixel reuses in spatial reuse, and how few shifts that takes.

A pair estimator needs the neighbour's path shifted here and this pixel's path shifted there. One
shift a neighbour is enough where neighbours are mutual, because the partner's shift is the other
half (:func:`paired`), and where they go round (:func:`ranked`): the pixel takes the path of one,
and its own sample is weighed against another, the one that takes its path. Given all paths, both
are each pixel of the class with the same expectation, and the halves of the estimators

    (1/k) sum_j m_{s_j} F(y_{s_j}) W J   and   (1/k) sum_j m_{c,t_j} F(x) W

add up to an unbiased one, because m_q + m_{c,q} = 1 for every q. Neighbours that are mere picks
take both shifts (:func:`scored`).

What is handed on as confidence, like the choice itself and the number of neighbours, depends on the
G-buffer and on earlier confidences, never on the paths' values.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit
from ..paths.spectrum import target
from ..resampling.reservoir import Reservoir
from ..sampling.dither import mask_texture
from ..sampling.masks import load_mask
from ..sampling.pairing import PairingTile, pairing_tile, partner
from ..sampling.streams import NEIGHBORS, SPATIAL, Stream, pass_stream
from .ranks import Groups, Ranks, rank_pixels, scattered_groups, surface_labels
from .reuse import similar
from .scores import Disk, pick_by_score
from .spatial import PairEstimators, Pixels, Pulled, canonical_share, merge, pull, push


@dataclass
class Exchange:
    """What spatial reuse merges.

    Fields: ``pulled`` (list of :class:`Pulled`, one per neighbour), ``shares`` (list of ``Float``,
    weights of the canonical sample in the pairs; 0 where a pair is not valid), ``confidence``
    (``Float``, what the merged reservoirs hand on), ``outcomes`` (list of ``UInt32``, of all
    shifts).
    """

    pulled: list[Pulled]
    shares: list[Any]
    confidence: Any
    outcomes: list[Any]


def spatial(
    pixels: Pixels,
    sampling: Sampling,
    layout: Any,
    reservoirs: Reservoir,
    round_index: Any,
    sample: Any,
    seed: Any,
) -> tuple[Reservoir, Any, PairEstimators, list[Any]]:
    """One round of spatial reuse.

    Parameters
    ----------
    sampling, layout : Sampling, Any
        How neighbours are found, and the data that it made for that.
    round_index, sample, seed : UInt32
        Number of the round, of the frame's first sample, and the user's seed.

    Returns
    -------
    reservoirs, color, estimators
        See :func:`mitsuba_restir.passes.spatial.merge`.
    outcomes : list of UInt32
        Outcomes of the shifts.
    """
    # Common to all pixels, and anew for every round.
    choices = pass_stream(NEIGHBORS, round_index, sample, seed)
    exchange = sampling.exchange(pixels, layout, reservoirs, choices)
    pixel = dr.arange(mi.UInt32, dr.width(reservoirs.weight))
    selection = pass_stream(SPATIAL, pixel, sample, seed ^ (round_index << 24))
    merged = merge(reservoirs, exchange.pulled, exchange.shares, exchange.confidence, selection)
    return *merged, exchange.outcomes


def paired(pixels: Pixels, tile: PairingTile, reservoirs: Reservoir, choices: Stream) -> Exchange:
    """Exchange paths in reciprocal pairs: the shift of q's path to p serves both p and q."""
    pixel = dr.arange(mi.UInt32, dr.width(reservoirs.weight))
    pulled = []
    for j in range(pixels.neighbors):
        # Opaque, so that all neighbours share one kernel.
        other, inside = partner(tile, choices, dr.opaque(mi.UInt32, j), pixel, pixels.size)
        there = dr.gather(PrimaryHit, pixels.hits, other, inside)
        # Similarity need not be symmetric: each side's own test decides whether it reuses the
        # other.
        valid = inside & similar(pixels.hits, there)
        theirs = pull(pixels, reservoirs, other, valid, inside & similar(there, pixels.hits))
        dr.eval(theirs)
        pulled.append(theirs)
    shares, confidence = [], mi.Float(reservoirs.confidence)
    for theirs in pulled:
        shares.append(_mutual_share(pixels, reservoirs, theirs))
        confidence += dr.gather(mi.Float, reservoirs.confidence, theirs.source, theirs.valid)
    return Exchange(pulled, shares, confidence, [theirs.outcome for theirs in pulled])


def _mutual_share(pixels: Pixels, reservoirs: Reservoir, theirs: Pulled) -> Any:
    reach = dr.gather(mi.Float, theirs.reach, theirs.source, theirs.valid)
    return dr.select(theirs.valid, canonical_share(pixels, reservoirs, reach), 0)


def ranked(pixels: Pixels, groups: Groups, reservoirs: Reservoir, choices: Stream) -> Exchange:
    """Exchange paths by rank in groups, see :mod:`mitsuba_restir.passes.ranks`."""
    labels = surface_labels(pixels.hits, choices)
    values = target(reservoirs.color) * reservoirs.weight
    dr.eval(labels, values)
    ranks = rank_pixels(
        groups, pixels.width, pixels.height, labels, values, reservoirs.confidence, choices
    )
    dr.eval(ranks)
    pixel = dr.arange(mi.UInt32, dr.width(reservoirs.weight))
    shared = ranks.count > 1
    pulled = []
    for j in range(pixels.neighbors):
        source = ranks.source(dr.opaque(mi.UInt32, j), pixels.neighbors)
        # A pixel that meets itself has g_i = g_0, and needs no shift.
        other = shared & (source != pixel)
        theirs = pull(pixels, reservoirs, source, other, other)
        dr.eval(theirs)
        pulled.append(replace(theirs, valid=shared))
    shares = _circulating_shares(pixels, reservoirs, ranks, pulled)
    confidence = expected_confidence(reservoirs.confidence, ranks, pixels.neighbors)
    return Exchange(pulled, shares, confidence, [theirs.outcome for theirs in pulled])


def _circulating_shares(
    pixels: Pixels, reservoirs: Reservoir, ranks: Ranks, pulled: list[Pulled]
) -> list[Any]:
    """Weights of the canonical sample against the pixels that take its path."""
    pixel = dr.arange(mi.UInt32, dr.width(reservoirs.weight))
    shared = ranks.count > 1
    reaches = dr.concat([theirs.reach for theirs in pulled])
    shares = []
    for t in range(pixels.neighbors):
        taker, j = ranks.taker(t, pixels.neighbors)
        entry = j * dr.width(pixel) + taker
        reach = dr.gather(mi.Float, reaches, entry, shared & (taker != pixel))
        shares.append(dr.select(shared, canonical_share(pixels, reservoirs, reach), 0))
    return shares


def expected_confidence(own: Any, ranks: Ranks, neighbors: int) -> Any:
    """Confidence of every pixel and, in expectation, of its picks.

    The picks' own would go with their ranks, and so with what the merged reservoir holds.
    """
    others = (ranks.confidence - own) * (neighbors / dr.maximum(mi.Float(ranks.count), 1))
    return own + dr.select(ranks.count > 1, others, 0)


def scored(pixels: Pixels, disk: Disk, reservoirs: Reservoir, choices: Stream) -> Exchange:
    """Reuse picks with good scores of the G-buffer, see :mod:`mitsuba_restir.passes.scores`."""
    pulled, shares, outcomes = [], [], []
    confidence = mi.Float(reservoirs.confidence)
    for j in range(pixels.neighbors):
        other, found = pick_by_score(
            disk, pixels.hits, pixels.size, dr.opaque(mi.UInt32, j), pixels.neighbors, choices
        )
        valid = found & similar(pixels.hits, dr.gather(PrimaryHit, pixels.hits, other, found))
        theirs = pull(pixels, reservoirs, other, valid, mi.Bool(False))
        dr.eval(theirs)
        reach, outcome = push(pixels, reservoirs, other, valid)
        own = dr.select(valid, canonical_share(pixels, reservoirs, reach), 0)
        confidence += dr.gather(mi.Float, reservoirs.confidence, other, valid)
        dr.eval(own, outcome, confidence)
        pulled.append(theirs)
        shares.append(own)
        outcomes += [theirs.outcome, outcome]
    return Exchange(pulled, shares, confidence, outcomes)


@dataclass(frozen=True)
class Sampling:
    """A way to find neighbours.

    Attributes
    ----------
    layout : callable
        (radius [pixels]) -> what ``exchange`` needs, made once.
    exchange : callable
        (pixels, layout, reservoirs, choices) -> :class:`Exchange`.
    """

    layout: Callable[[float], Any]
    exchange: Callable[[Pixels, Any, Reservoir, Stream], Exchange]


def _scattered(mask: str) -> Callable[[float], Groups]:
    return lambda radius: scattered_groups(mask_texture(load_mask(mask)), radius)


SAMPLING = {
    "random": Sampling(pairing_tile, paired),
    "blue_noise": Sampling(_scattered("void_and_cluster"), ranked),
    "white_noise": Sampling(_scattered("white"), ranked),
    "blocks": Sampling(lambda _: Groups(mask_texture(load_mask("white")), 16, 1), ranked),
    "geometry": Sampling(Disk, scored),
}
"""The values of ``neighbor_sampling``."""
