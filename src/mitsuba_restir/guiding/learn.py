"""Learning: one frame's reservoirs make the next frame's guide.

The reservoirs of the fresh candidates, before any reuse, say where light came from: at x_1 along
the direction to x_2, where that is the reconnection vertex, and at x_k along the direction that
leaves it, unless it was sampled from a light. They count with lum(F W), bounded so that no firefly
owns a cell. After temporal reuse the same paths would count many times, and the guide be worse.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit, camera_ray
from ..paths.record import Kind, edge_count, kind_of, reconnection_index
from ..paths.scattering import evaluate
from ..paths.spectrum import target
from ..paths.vertex import exists, sight
from ..resampling.reservoir import Reservoir
from .cells import Cells, cell_at
from .guide import Guide, alpha_at, leaf_of, pdf
from .share import cheapest, nothing_paid, pay, settled
from .steering import steerable
from .trees import count, grown, nothing_counted

BOUND = 20.0
"""Largest luminance that counts, relative to the mean of the frame before."""


def learn(
    cells: Cells, guide: Guide, reservoirs: Reservoir, hit: PrimaryHit, memory: float
) -> Guide:
    """The guide with a frame in it.

    Parameters
    ----------
    reservoirs, hit : Reservoir, PrimaryHit
        One lane per pixel; evaluated.
    memory : float
        What earlier lessons count with, relative to the one after them; 1 where nothing moves.
    """
    path = reservoirs.path
    kind = kind_of(path)
    shown = target(reservoirs.color) * reservoirs.weight
    mean = dr.mean(shown)
    bound = BOUND * dr.select(guide.mean > 0, guide.mean, mean)
    value = dr.select(bound > 0, dr.minimum(shown / bound, 1), 0)
    book = Book(cells, nothing_counted(), nothing_paid())

    lambdas = dr.zeros(mi.Ray3f).wavelengths
    lit = value > 0
    seen = sight(path.vertex, lambda _: hit.vertex.p, lambdas, lit & exists(path.vertex))
    direction = dr.select(kind == Kind.ENVIRONMENT, path.wo, seen.ray.d)
    k = reconnection_index(path)
    sampled = (kind == Kind.REPLAY_NEE) & (edge_count(path) == 2)
    lesson = Lesson(mi.UInt32(1), direction, value, lit & ~sampled, k == 2)
    ray, pi = camera_ray(hit, lambdas)
    _study(guide, book, pi.compute_surface_interaction(ray, active=lesson.active), lesson)
    leaves = lit & ((kind == Kind.FAR) | (kind == Kind.HIT))
    lesson = Lesson(k, path.wo, value, leaves, leaves)
    _study(guide, book, seen.si, lesson)
    sums = grown(guide.sums, memory, book.counts, bound)
    costs = settled(guide.costs, memory, book.bills)
    return replace(guide, sums=sums, costs=costs, alpha=cheapest(costs, sums[0] > 0), mean=mean)


@dataclass
class Book:
    """What a frame's lessons add up to, by ``cells``: ``counts`` of bins, ``bills`` of shares."""

    cells: Cells
    counts: mi.UInt32
    bills: mi.UInt64


@dataclass
class Lesson:
    """Luminance F W (over the largest that counts) that came along a direction to a vertex.

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
    book: Book,
    si: mi.SurfaceInteraction3f,
    lesson: Lesson,
) -> None:
    """Add a lesson at a vertex."""
    bsdf = si.bsdf()
    active = lesson.active & steerable(bsdf)
    stored = active & lesson.stored
    _, density = evaluate(si, bsdf, lesson.direction, stored)
    stored &= density > 0
    cell = cell_at(book.cells, si.p, si.n)
    ratio = dr.select(stored, pdf(guide, cell, lesson.direction, stored) / density, 0)
    alpha = alpha_at(guide, cell, lesson.vertex, active)
    cost = dr.square(lesson.value) * (alpha + (1 - alpha) * ratio)
    pay(book.bills, cell, cost, ratio, active)

    cell = cell_at(book.cells, _moved(book.cells, si), si.n)
    count(book.counts, cell, leaf_of(lesson.direction), lesson.value, stored)


def _moved(cells: Cells, si: mi.SurfaceInteraction3f) -> mi.Point3f:
    """A point beside another one: neighbouring cells learn from each other, which smooths them."""
    lane = dr.arange(mi.UInt32, dr.width(si.p))
    a, b = mi.sample_tea_32(
        dr.reinterpret_array(mi.UInt32, si.p.x) ^ lane, dr.reinterpret_array(mi.UInt32, si.p.y)
    )
    u, v = (mi.Float(bits >> 8) * 2.0**-24 - 0.5 for bits in (a, b))
    frame = mi.Frame3f(si.n)
    return si.p + (frame.s * u + frame.t * v) / cells.scale
