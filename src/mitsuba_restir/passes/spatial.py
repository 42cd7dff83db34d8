"""Spatial reuse: merge each pixel with similar partners by defensive pairwise MIS.

Lin et al. 2022 (GRIS), section 7.1 and supplement. With canonical sample x, V similar neighbours
x_i out of k requested ones, and confidences c, neighbour i and the canonical sample are paired by

    m_i(y)  = c_i p_i(T^-1 y) |J^-1| / (c_i p_i(T^-1 y) |J^-1| + (c/k) p(y)),   m_i + m_{c,i} = 1,

and the pixel is the plain mean of the V + 1 estimators that the pairs and the canonical sample are:

    g_0 = F(x) W,     g_i = m_i F(y_i) W_i J_i + m_{c,i} F(x) W.

Each has the expectation of the pixel. Their luminance sums to that of the selected sample, so
shading by the mean of the g (vector weights) changes colour noise only.

Neighbours are reciprocal: the shift of q's path to p serves both, as y_i of p and in m_{c,i} of q,
and is computed once, by :func:`exchange`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit
from ..paths.record import PathRecord
from ..paths.spectrum import target
from ..resampling.mis import density, share
from ..resampling.reservoir import Reservoir
from ..sampling.pairing import PairingTile, partner
from ..sampling.streams import NEIGHBORS, SPATIAL, Stream, pass_stream, uniform
from ..shifts.hybrid import shift
from ..shifts.mapping import ShiftMapping
from .reuse import similar, with_factor


@dataclass
class Exchanged:
    """The path of one partner of every pixel, shifted to the pixel.

    Fields: ``partner`` (``UInt32``, row-major pixel index), ``valid`` (``Bool``, it exists and is
    similar in the G-buffer), ``color`` (``Color3f``, F of the shifted path here), ``factor`` (its
    own p G p), ``weight`` (m_i W_i J_i: what F counts with), ``reach`` (c p J: the density with
    which this pixel makes the partner's path, for the partner's MIS weight), ``outcome`` (of the
    shift).
    """

    partner: Any
    valid: Any
    color: Any
    factor: Any
    weight: Any
    reach: Any
    outcome: Any


@dataclass
class PairEstimators:
    """The estimators g_0 .. g_k of every pixel, each with the expectation of the pixel.

    Fields: ``colors`` (list of ``Color3f``, the canonical sample's first), ``valid`` (list of
    ``Bool``: the pixel has this pair; where not, the colour is zero).
    """

    colors: list[Any]
    valid: list[Any]


def neighbor_choices(round_index: Any, sample: Any, seed: Any) -> Stream:
    """The stream, common to all pixels, that draws a round's pairings."""
    return pass_stream(NEIGHBORS, round_index, sample, seed)


def exchange(
    scene: mi.Scene,
    sensor: mi.Sensor | None,
    reservoirs: Reservoir,
    hits: PrimaryHit,
    size: tuple[Any, Any],
    tile: PairingTile,
    index: Any,
    neighbors: int,
    choices: Stream,
    mapping: ShiftMapping,
) -> Exchanged:
    """Shift the path of its ``index``-th partner to every pixel.

    Paths are pulled rather than pushed: the lanes of a packet then start from adjacent pixels.

    Parameters
    ----------
    reservoirs, hits : Reservoir, PrimaryHit
        All pixels' reservoirs and primary hits, row-major.
    size : (UInt32, UInt32)
        Width and height in pixels.
    index : UInt32
        Number of the partner, below ``neighbors`` (opaque, so that all share one kernel).
    choices : Stream
        See :func:`neighbor_choices`.
    """
    pixel = dr.arange(mi.UInt32, dr.width(hits.vertex.p))
    other, inside = partner(tile, choices, index, pixel, size)
    there = dr.gather(PrimaryHit, hits, other, inside)
    theirs = dr.gather(Reservoir, reservoirs, other, inside)
    # Similarity need not be symmetric: each side's own test decides whether it reuses the other.
    valid = inside & similar(hits, there)
    wanted = inside & (valid | similar(there, hits)) & (theirs.weight > 0)
    shifted = shift(scene, sensor, theirs.path, hits, mapping, wanted)
    m_other = share(
        density(theirs.confidence, target(theirs.color), 1 / shifted.jacobian),
        reservoirs.confidence / neighbors * target(shifted.color),
    )
    used = valid & (target(shifted.color) > 0)
    return Exchanged(
        other,
        valid,
        shifted.color,
        shifted.factor,
        dr.select(used, m_other * shifted.jacobian * theirs.weight, 0),
        density(reservoirs.confidence, target(shifted.color), shifted.jacobian),
        shifted.outcome,
    )


def merge(
    reservoirs: Reservoir, exchanged: list[Exchanged], round_index: Any, sample: Any, seed: Any
) -> tuple[Reservoir, Any, PairEstimators]:
    """Merge the partners' paths into every pixel's reservoir.

    Parameters
    ----------
    exchanged : list of Exchanged
        One entry per partner.

    Returns
    -------
    reservoir : Reservoir
        The merged reservoirs.
    color : Color3f
        Mean of the pair estimators.
    estimators : PairEstimators
        One entry for the canonical sample and one per partner.
    """
    pixel = dr.arange(mi.UInt32, dr.width(reservoirs.weight))
    random = pass_stream(SPATIAL, pixel, sample, seed ^ (round_index << 24))
    canonical = reservoirs.color * reservoirs.weight
    own = reservoirs.confidence / len(exchanged) * target(reservoirs.color)

    total = mi.Float(0)  # sum of resampling weights
    selected = mi.UInt32(pixel)  # pixel whose path leads
    selected_color = mi.Color3f(reservoirs.color)
    selected_factor = mi.Float(reservoirs.path.jacobian)
    color = mi.Color3f(0)  # sum of the pair estimators g_i
    canonical_share = mi.Float(1)  # sum of the canonical sample's pairwise weights
    count = mi.Float(1)  # V + 1
    confidence = mi.Float(reservoirs.confidence)
    estimators = PairEstimators([canonical], [mi.Bool(True)])

    for i, theirs in enumerate(exchanged):
        weight = theirs.weight * target(theirs.color)
        total += weight
        take = (weight > 0) & (uniform(random, i, 0) * total < weight)
        selected = dr.select(take, theirs.partner, selected)
        selected_color = dr.select(take, theirs.color, selected_color)
        selected_factor = dr.select(take, theirs.factor, selected_factor)

        reach = dr.gather(mi.Float, theirs.reach, theirs.partner, theirs.valid)
        color += theirs.weight * theirs.color
        pair_share = dr.select(theirs.valid, share(own, reach), 0)
        canonical_share += pair_share
        estimators.colors.append(theirs.weight * theirs.color + pair_share * canonical)
        estimators.valid.append(theirs.valid)
        count += dr.select(theirs.valid, mi.Float(1), 0)
        confidence += dr.gather(mi.Float, reservoirs.confidence, theirs.partner, theirs.valid)

    weight = canonical_share * target(canonical)
    total += weight
    keep = uniform(random, len(exchanged), 0) * total < weight
    selected = dr.select(keep, pixel, selected)
    selected_color = dr.select(keep, reservoirs.color, selected_color)
    selected_factor = dr.select(keep, reservoirs.path.jacobian, selected_factor)

    leading = target(selected_color)
    merged = Reservoir(
        with_factor(dr.gather(PathRecord, reservoirs.path, selected), selected_factor),
        selected_color,
        dr.select(leading > 0, total / (count * leading), 0),
        confidence,
    )
    return merged, (color + canonical_share * canonical) / count, estimators
