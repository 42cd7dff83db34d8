"""Random replay: repeat a path's prefix from another primary hit with the path's own numbers."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit, camera_ray
from ..paths.scattering import scatter
from ..sampling.streams import Stream
from .connectability import Departure, depart_scattered
from .mapping import Outcome
from .scope import Scope


@dataclass
class Head:
    """The last replayed vertex y_h, not yet looked at.

    Fields: ``ray`` and ``pi`` (how it was found), ``throughput`` (f cos/p up to y_h), ``start``
    (:class:`Departure` from y_{h-1}; delta and meaningless for h = 1), ``index`` (h), ``footprint``
    (of the pixel), ``scattered`` (by more than null lobes), ``outcome`` (``Outcome.OK`` or why the
    replay failed).
    """

    ray: mi.Ray3f
    pi: mi.PreliminaryIntersection3f
    throughput: mi.Spectrum
    start: Departure
    index: mi.UInt32
    footprint: mi.Float
    scattered: mi.Bool
    outcome: mi.UInt32


def at_primary(hit: PrimaryHit, lambdas: mi.Spectrum, throughput: mi.Spectrum) -> Head:
    """The head of a path that has only reached its primary hit."""
    ray, pi = camera_ray(hit, lambdas)
    nowhere = Departure(dr.zeros(mi.Point3f), mi.Float(0), mi.Bool(True), mi.Float(0), mi.Float(0))
    index, outcome = mi.UInt32(1), mi.UInt32(Outcome.OK)
    return Head(
        ray, pi, mi.Spectrum(throughput), nowhere, index, hit.footprint, mi.Bool(False), outcome
    )


@dr.syntax
def replay(scope: Scope, stream: Stream, head: Head, bounces: mi.UInt32, active: mi.Bool) -> Head:
    """Replay ``bounces`` bounces of the path ``stream`` from the primary hit ``head``.

    The replay fails where the path ends early, or where a pair before the head passes the
    connectability test: the path's own first reconnection vertex would then be another one, and
    the shift could not be inverted.
    """
    mapping, footprint = scope.mapping, head.footprint
    ray, pi, throughput = head.ray, head.pi, head.throughput
    start, j, scattered, outcome = head.start, head.index, head.scattered, head.outcome
    active = mi.Bool(active)

    while dr.hint(active & (j <= bounces), exclude=[scope, mapping], label="Random replay"):
        si = pi.compute_surface_interaction(ray)
        bsdf = si.bsdf()
        limit = mapping.criterion.vertex_limit(si, bsdf, active)
        arrival = mapping.link(start, ray, si, limit, j, footprint)
        bounce = scatter(si, bsdf, stream, j, active)
        connectable = ~bounce.delta & (bounce.pdf <= arrival.limit)
        throughput *= bounce.weight
        scattered |= ~bounce.null

        start = depart_scattered(si, bounce, limit)
        ray = si.spawn_ray(bounce.wo)
        active &= ~connectable & (dr.max(dr.abs(throughput)) != 0)
        pi = scope.scene.ray_intersect_preliminary(ray, coherent=False, active=active)
        outcome = dr.select(
            connectable,
            Outcome.INVERTIBILITY,
            dr.select(active, mi.UInt32(Outcome.OK), Outcome.TERMINATED),
        )
        j += 1
        # Only the last replayed bounce may leave the scene (a path that ends in the environment).
        active &= pi.is_valid() | (j > bounces)
        outcome = dr.select((outcome == Outcome.OK) & ~active, Outcome.TERMINATED, outcome)

    return Head(ray, pi, throughput, start, j, footprint, scattered, outcome)
