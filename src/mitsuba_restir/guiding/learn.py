"""Learning: one frame's reservoirs make the next frame's guide.

The reservoirs of the fresh candidates, before any reuse, say where light came from (with those after
temporal reuse the same paths count many times, and the guide is a worse one): at x_1 along the
direction to x_2, where that is the reconnection vertex, and at x_k along the direction that leaves
it, unless it was sampled from a light. They count with lum(F W), bounded so that no firefly owns a
cell.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit, camera_ray
from ..paths.record import Kind, edge_count, kind_of, reconnection_index
from ..paths.scattering import evaluate
from ..paths.spectrum import target
from ..paths.vertex import seen_from
from ..resampling.reservoir import Reservoir
from .cells import cell_at
from .guide import LEVELS, NODES, Guide, alpha_at, leaf_of, pdf
from .share import FORGETTING, cheapest, paid
from .steering import steerable

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
    learnt = replace(
        guide,
        sums=guide.sums if memory == 1 else guide.sums * memory,
        costs=guide.costs * (FORGETTING * memory),
        mean=mean,
    )

    lambdas = dr.zeros(mi.Ray3f).wavelengths
    span = path.vertex.p - hit.vertex.p
    direction = dr.select(kind == Kind.ENVIRONMENT, path.wo, span * dr.rsqrt(dr.squared_norm(span)))
    lit = value > 0
    k = reconnection_index(path)
    sampled = (kind == Kind.REPLAY_NEE) & (edge_count(path) == 2)
    lesson = Lesson(mi.UInt32(1), direction, value, lit & ~sampled, k == 2)
    _study(guide, learnt, *camera_ray(hit, lambdas), lesson)
    leaves = lit & ((kind == Kind.FAR) | (kind == Kind.HIT))
    lesson = Lesson(k, path.wo, value, leaves, leaves)
    _study(guide, learnt, *seen_from(path.vertex, hit.vertex.p, lambdas), lesson)
    learnt.alpha = cheapest(learnt.costs, learnt.sums)
    return learnt


@dataclass
class Lesson:
    """Luminance F W that came along a direction to the vertex of this index.

    ``stored``: whether the path's record has the direction; those that are replayed cannot be
    guided, and only cost what the guide takes from them.
    """

    vertex: mi.UInt32
    direction: mi.Vector3f
    value: mi.Float
    active: mi.Bool
    stored: mi.Bool


def _study(
    guide: Guide,
    learnt: Guide,
    ray: mi.Ray3f,
    pi: mi.PreliminaryIntersection3f,
    lesson: Lesson,
) -> None:
    """Add a lesson at the vertex that a ray has found."""
    si = pi.compute_surface_interaction(ray, active=lesson.active)
    bsdf = si.bsdf()
    active = lesson.active & steerable(bsdf)
    stored = active & lesson.stored
    _, density = evaluate(si, bsdf, lesson.direction, stored)
    stored &= density > 0
    cell = cell_at(guide.cells, si.p, si.n)
    ratio = dr.select(stored, pdf(guide, cell, lesson.direction, stored) / density, 0)
    alpha = alpha_at(guide, cell, lesson.vertex, active)
    cost = dr.square(lesson.value) * (alpha + (1 - alpha) * ratio)
    paid(learnt.costs, cell, cost, ratio, active)

    heap = cell_at(guide.cells, _moved(guide, si), si.n) * NODES
    leaf = leaf_of(lesson.direction)
    for level in range(LEVELS + 1):
        dr.scatter_add(learnt.sums, lesson.value, heap + (leaf >> level), stored)


def _moved(guide: Guide, si: mi.SurfaceInteraction3f) -> mi.Point3f:
    """A point beside another one: neighbouring cells learn from each other, which smooths them."""
    lane = dr.arange(mi.UInt32, dr.width(si.p))
    a, b = mi.sample_tea_32(
        dr.reinterpret_array(mi.UInt32, si.p.x) ^ lane, dr.reinterpret_array(mi.UInt32, si.p.y)
    )
    u, v = (mi.Float(bits >> 8) * 2.0**-24 - 0.5 for bits in (a, b))
    frame = mi.Frame3f(si.n)
    return si.p + (frame.s * u + frame.t * v) / guide.cells.scale
