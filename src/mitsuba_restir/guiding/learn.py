"""Learning: one frame's reservoirs make the next frame's guide.

The reservoirs after temporal and before spatial reuse say where light came from: at x_1 along the
direction to x_2, where that is the reconnection vertex, and at x_k along the direction that leaves
it, unless it was sampled from a light. They count with lum(F W), bounded so that no firefly owns a
cell.
"""

from __future__ import annotations

from dataclasses import replace

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit
from ..paths.record import Kind, kind_of, reconnection_index
from ..paths.spectrum import target
from ..paths.vertex import seen_from
from ..resampling.reservoir import Reservoir
from .guide import LEVELS, Guide, cell_at, leaf_of

BOUND = 20.0
"""Largest luminance that counts, relative to the mean of the frame before."""


def learn(guide: Guide, reservoirs: Reservoir, hit: PrimaryHit, memory: float) -> Guide:
    """The guide with a frame in it.

    Parameters
    ----------
    reservoirs, hit : Reservoir, PrimaryHit
        One lane per pixel; evaluated.
    memory : float
        What earlier frames count with, relative to the frame after them; 1 where nothing moves.
    """
    path = reservoirs.path
    kind = kind_of(path)
    shown = target(reservoirs.color) * reservoirs.weight
    mean = dr.mean(shown)
    bound = BOUND * dr.select(guide.mean > 0, guide.mean, mean)
    value = dr.minimum(shown, bound)
    sums = guide.sums if memory == 1 else guide.sums * memory

    second = (value > 0) & (reconnection_index(path) == 2)
    span = path.vertex.p - hit.vertex.p
    direction = dr.select(kind == Kind.ENVIRONMENT, path.wo, span * dr.rsqrt(dr.squared_norm(span)))
    cell = cell_at(guide, hit.vertex.p, hit.normal)
    sums = _added(sums, cell, leaf_of(direction), value, second)

    leaves = (value > 0) & ((kind == Kind.FAR) | (kind == Kind.HIT))
    ray, pi = seen_from(path.vertex, hit.vertex.p, dr.zeros(mi.Ray3f).wavelengths)
    si = pi.compute_surface_interaction(ray, active=leaves)
    cell = cell_at(guide, path.vertex.p, si.n)
    sums = _added(sums, cell, leaf_of(path.wo), value, leaves)
    return replace(guide, sums=sums, mean=mean)


def _added(
    sums: mi.Float, cell: mi.UInt32, leaf: mi.UInt32, value: mi.Float, active: mi.Bool
) -> mi.Float:
    for level in range(LEVELS + 1):
        dr.scatter_add(sums, value, cell + (leaf >> level), active)
    return sums
