"""Spatial reuse: merge each pixel with similar neighbours by defensive pairwise MIS.

Lin et al. 2022 (GRIS), section 7.1 and supplement. With canonical sample x, V similar neighbours x_i
out of k requested ones, and confidences c, neighbour i and the canonical sample are paired by

    m_i(y)  = c_i p_i(T^-1 y) |J^-1| / (c_i p_i(T^-1 y) |J^-1| + (c/k) p(y)),   m_i + m_{c,i} = 1,

and the pixel is the plain mean of the V + 1 estimators that the pairs and the canonical sample are:

    g_0 = F(x) W,     g_i = m_i F(y_i) W_i J_i + m_{c,i} F(x) W.

Each has the expectation of the pixel. Their luminance sums to that of the selected sample, so
shading by the mean of the g (vector weights) changes colour noise only.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit
from ..paths.spectrum import target
from ..resampling.mis import density, share
from ..resampling.reservoir import Reservoir, finalize, offer
from ..sampling.streams import SPATIAL, pass_stream, uniform2
from ..shifts.hybrid import shift
from ..shifts.mapping import ShiftMapping
from .neighbors import disk_neighbor
from .reuse import similar, with_factor


@dr.syntax
def spatial(
    scene: mi.Scene,
    sensor: mi.Sensor,
    reservoirs: Reservoir,
    hits: PrimaryHit,
    size: tuple[Any, Any],
    neighbors: int,
    radius: float,
    round_index: Any,
    sample: Any,
    seed: Any,
    mapping: ShiftMapping,
) -> tuple[Reservoir, Any, Any]:
    """One round of spatial resampling.

    Parameters
    ----------
    reservoirs, hits : Reservoir, PrimaryHit
        All pixels' reservoirs and primary hits, row-major.
    size : (UInt32, UInt32)
        Width and height in pixels.
    neighbors, radius : int, float
        Number of neighbours requested and the radius [pixels] of the disk they are drawn from.

    Returns
    -------
    reservoir : Reservoir
        The merged reservoirs.
    color : Color3f
        Mean of the pair estimators.
    outcomes : UInt32
        Outcomes of the shifts, 3 bits each, neighbours first to last (to the pixel, then from it).
    """
    pixel = dr.arange(mi.UInt32, dr.width(hits.vertex.p))
    choices = pass_stream(SPATIAL, pixel, sample, seed ^ (round_index << 24))
    canonical = reservoirs.color * reservoirs.weight
    fraction = reservoirs.confidence / neighbors
    own = fraction * target(reservoirs.color)

    merged = Reservoir(
        reservoirs.path, reservoirs.color, mi.Float(0), mi.Float(reservoirs.confidence)
    )
    color = mi.Color3f(0)  # sum of the pair estimators g_i
    canonical_share = mi.Float(1)  # sum of the canonical sample's pairwise weights
    valid_count = mi.UInt32(0)  # V
    outcomes = mi.UInt32(0)
    i = mi.UInt32(0)

    while dr.hint(i < neighbors, exclude=[mapping], label="Spatial reuse"):
        other, inside = disk_neighbor(choices, i, pixel, size, radius)
        near = dr.gather(PrimaryHit, hits, other, inside)
        valid = inside & similar(hits, near)
        theirs = dr.gather(Reservoir, reservoirs, other, valid)

        forward = shift(
            scene, sensor, theirs.path, hits, mapping, valid & (theirs.weight > 0)
        )
        backward = shift(
            scene, sensor, reservoirs.path, near, mapping, valid & (reservoirs.weight > 0)
        )
        m_other = share(
            density(theirs.confidence, target(theirs.color), 1 / forward.jacobian),
            fraction * target(forward.color),
        )
        m_own = share(
            own, density(theirs.confidence, target(backward.color), backward.jacobian)
        )

        contribution = m_other * forward.jacobian * theirs.weight
        merged = offer(
            merged,
            with_factor(theirs.path, forward.factor),
            forward.color,
            contribution * target(forward.color),
            uniform2(choices, i, 2)[0],
            valid & (theirs.weight > 0),
        )
        merged.confidence += dr.select(valid, theirs.confidence, 0)
        used = valid & (theirs.weight > 0)
        color += dr.select(used, contribution * forward.color, 0)
        canonical_share += dr.select(valid, m_own, 0)
        valid_count += dr.select(valid, mi.UInt32(1), 0)
        outcomes |= (forward.outcome | (backward.outcome << 3)) << (6 * i)
        i += 1

    merged = offer(
        merged,
        reservoirs.path,
        reservoirs.color,
        canonical_share * target(canonical),
        uniform2(choices, neighbors, 2)[0],
        mi.Bool(True),
    )
    count = mi.Float(valid_count) + 1
    color = (color + canonical_share * canonical) / count
    return finalize(merged, count), color, outcomes
