"""Spatial reuse: merge each pixel with similar partners by defensive pairwise MIS.

Lin et al. 2022 (GRIS), section 7.1 and supplement. With canonical sample x, V similar neighbours x_i
out of k requested ones, and confidences c, neighbour i and the canonical sample are paired by

    m_i(y)  = c_i p_i(T^-1 y) |J^-1| / (c_i p_i(T^-1 y) |J^-1| + (c/k) p(y)),   m_i + m_{c,i} = 1,

and the pixel is the plain mean of the V + 1 estimators that the pairs and the canonical sample are:

    g_0 = F(x) W,     g_i = m_i F(y_i) W_i J_i + m_{c,i} F(x) W.

Each has the expectation of the pixel. Their luminance sums to that of the selected sample, so
shading by the mean of the g (vector weights) changes colour noise only.

Neighbours are reciprocal: the shift of q's path to p is needed by both, as y_i of p and for m_{c,i}
of q, and is computed once, by :func:`exchange`.
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
from ..shifts.hybrid import Shifted, shift
from ..shifts.mapping import ShiftMapping
from .reuse import similar, with_factor


@dataclass
class Exchanged:
    """The path of each of a pixel's partners shifted to it: k blocks of one lane per pixel.

    Fields: ``shifted`` (:class:`Shifted`), ``partner`` (``UInt32``, row-major pixel index),
    ``valid`` (``Bool``, the partner exists and is similar in the G-buffer, seen from this pixel).
    """

    shifted: Shifted
    partner: Any
    valid: Any


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
    neighbors: int,
    choices: Stream,
    mapping: ShiftMapping,
) -> Exchanged:
    """Shift the paths of its ``neighbors`` partners to every pixel (one lane per pair and side).

    Paths are pulled rather than pushed: the lanes of a packet then start from adjacent pixels.

    Parameters
    ----------
    reservoirs, hits : Reservoir, PrimaryHit
        All pixels' reservoirs and primary hits, row-major.
    size : (UInt32, UInt32)
        Width and height in pixels.
    choices : Stream
        See :func:`neighbor_choices`.
    """
    pixels = dr.width(hits.vertex.p)
    lane = dr.arange(mi.UInt32, pixels * neighbors)
    index = lane // dr.opaque(mi.UInt32, pixels)
    pixel = lane - index * dr.opaque(mi.UInt32, pixels)
    other, inside = partner(tile, choices, index, pixel, size)
    here = dr.gather(PrimaryHit, hits, pixel)
    there = dr.gather(PrimaryHit, hits, other, inside)
    # Similarity need not be symmetric: each side's own test decides whether it reuses the other.
    wanted = inside & (similar(here, there) | similar(there, here))
    path = dr.gather(PathRecord, reservoirs.path, other, wanted)
    weight = dr.gather(mi.Float, reservoirs.weight, other, wanted)
    shifted = shift(scene, sensor, path, here, mapping, wanted & (weight > 0))
    return Exchanged(shifted, other, inside & similar(here, there))


def merge(
    reservoirs: Reservoir,
    exchanged: Exchanged,
    neighbors: int,
    round_index: Any,
    sample: Any,
    seed: Any,
) -> tuple[Reservoir, Any]:
    """Merge the shifted paths into every pixel's reservoir.

    Returns
    -------
    reservoir : Reservoir
        The merged reservoirs.
    color : Color3f
        Mean of the pair estimators.
    """
    pixels = dr.width(reservoirs.weight)
    pixel = dr.arange(mi.UInt32, pixels)
    random = pass_stream(SPATIAL, pixel, sample, seed ^ (round_index << 24))
    canonical = reservoirs.color * reservoirs.weight
    fraction = reservoirs.confidence / neighbors
    own = fraction * target(reservoirs.color)

    total = mi.Float(0)  # sum of resampling weights
    selected = mi.UInt32(pixel)  # pixel whose path leads
    selected_color = mi.Color3f(reservoirs.color)
    selected_factor = mi.Float(reservoirs.path.jacobian)
    color = mi.Color3f(0)  # sum of the pair estimators g_i
    canonical_share = mi.Float(1)  # sum of the canonical sample's pairwise weights
    count = mi.Float(1)  # V + 1
    confidence = mi.Float(reservoirs.confidence)

    for i in range(neighbors):
        lane = pixel + i * dr.opaque(mi.UInt32, pixels)
        other = dr.gather(mi.UInt32, exchanged.partner, lane)
        valid = dr.gather(mi.Bool, exchanged.valid, lane)
        forward = dr.gather(Shifted, exchanged.shifted, lane)
        backward = dr.gather(
            Shifted, exchanged.shifted, other + i * dr.opaque(mi.UInt32, pixels), valid
        )
        their_color = dr.gather(mi.Color3f, reservoirs.color, other, valid)
        their_weight = dr.gather(mi.Float, reservoirs.weight, other, valid)
        their_confidence = dr.gather(mi.Float, reservoirs.confidence, other, valid)
        used = valid & (their_weight > 0) & (target(forward.color) > 0)

        m_other = share(
            density(their_confidence, target(their_color), 1 / forward.jacobian),
            fraction * target(forward.color),
        )
        m_own = share(own, density(their_confidence, target(backward.color), backward.jacobian))
        contribution = dr.select(used, m_other * forward.jacobian * their_weight, 0)
        weight = contribution * target(forward.color)
        total += weight
        take = used & (uniform(random, i, 0) * total < weight)
        selected = dr.select(take, other, selected)
        selected_color = dr.select(take, forward.color, selected_color)
        selected_factor = dr.select(take, forward.factor, selected_factor)

        color += dr.select(used, contribution * forward.color, 0)
        canonical_share += dr.select(valid, m_own, 0)
        count += dr.select(valid, mi.Float(1), 0)
        confidence += their_confidence

    weight = canonical_share * target(canonical)
    total += weight
    keep = uniform(random, neighbors, 0) * total < weight
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
    return merged, (color + canonical_share * canonical) / count
