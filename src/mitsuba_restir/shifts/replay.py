"""Random replay: repeat a path's prefix from another primary hit with the path's own numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit, camera_ray
from ..paths.scattering import scatter
from ..sampling.streams import Stream
from .connectability import Departure, depart_scattered, link
from .mapping import INVERTIBILITY, OK, TERMINATED, ShiftMapping


@dataclass
class Head:
    """The last replayed vertex y_h, not yet looked at.

    Fields: ``ray`` and ``pi`` (how it was found), ``throughput`` (``Spectrum``, f cos/p up to y_h),
    ``start`` (:class:`Departure` from y_{h-1}; delta and meaningless for h = 1), ``index`` (h),
    ``outcome`` (``OK`` or why the replay failed).
    """

    ray: Any
    pi: Any
    throughput: Any
    start: Departure
    index: Any
    outcome: Any


def at_primary(hit: PrimaryHit, lambdas: Any, throughput: Any) -> Head:
    """The head of a path that has only reached its primary hit."""
    ray, pi = camera_ray(hit, lambdas)
    nowhere = Departure(dr.zeros(mi.Point3f), mi.Float(0), mi.Bool(True), mi.Float(0), mi.Float(0))
    return Head(ray, pi, mi.Spectrum(throughput), nowhere, mi.UInt32(1), mi.UInt32(OK))


@dr.syntax
def replay(
    scene: mi.Scene,
    stream: Stream,
    hit: PrimaryHit,
    lambdas: Any,
    throughput: Any,
    bounces: Any,
    mapping: ShiftMapping,
    active: Any,
) -> Head:
    """Replay ``bounces`` bounces of the path ``stream`` from the primary hit ``hit``.

    The replay fails where the path ends early, or where a pair before the head passes the
    connectability test: the path's own first reconnection vertex would then be another one, and
    the shift could not be inverted.
    """
    head = at_primary(hit, lambdas, throughput)
    ray, pi, throughput = head.ray, head.pi, head.throughput
    start, j, outcome = head.start, head.index, head.outcome
    active = mi.Bool(active)

    while dr.hint(active & (j <= bounces), exclude=[mapping], label="Random replay"):
        si = pi.compute_surface_interaction(ray)
        bsdf = si.bsdf()
        limit = mapping.criterion.vertex_limit(si, bsdf, active)
        arrival = link(mapping.criterion, start, si, limit, j, mapping.last_index, hit.footprint)
        bounce = scatter(si, bsdf, stream, j, active)
        connectable = ~bounce.delta & (bounce.pdf <= arrival.limit)
        throughput *= bounce.weight

        start = depart_scattered(si, bounce, limit)
        ray = si.spawn_ray(bounce.wo)
        active &= ~connectable & (dr.max(dr.abs(throughput)) > 0)
        pi = scene.ray_intersect_preliminary(ray, coherent=False, active=active)
        outcome = dr.select(
            connectable, INVERTIBILITY, dr.select(active, mi.UInt32(OK), TERMINATED)
        )
        j += 1
        # Only the last replayed bounce may leave the scene (a path that ends in the environment).
        active &= pi.is_valid() | (j > bounces)
        outcome = dr.select((outcome == OK) & ~active, TERMINATED, outcome)

    return Head(ray, pi, throughput, start, j, outcome)
