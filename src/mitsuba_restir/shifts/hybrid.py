"""The hybrid shift: replay a path's prefix from another pixel, then reconnect to its stored vertex.

Lin et al. 2022 (GRIS), section 7. The measure is primary sample space, F = f/p per path; with
full-BSDF pdfs p, reconnecting y_{k-1} to x_k has the Jacobian

    J = p(y_{k-1} -> x_k) G(y_{k-1}, x_k) p(x_k -> x_{k+1}) / [the same of the base path],

the last factor only where the direction leaving x_k was sampled (kinds ``FAR`` and ``HIT``), and
G = |cos theta_k| / d^2 with the face normal (1 for the environment). Replay has Jacobian one.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit
from ..paths.record import Kind, PathRecord, edge_count, kind_of, reconnection_index
from ..paths.scattering import can_connect, emission, evaluate, sample_light
from ..paths.vertex import connected, exists
from .connectability import depart
from .ending import Ends, ending, own_factor
from .mapping import Outcome
from .replay import Head, at_primary, replay
from .scope import Scope


@dataclass
class Shifted:
    """A path shifted to another pixel.

    Fields: ``color`` (F in the new pixel; 0 where the shift is undefined), ``jacobian`` (|dT/dx|),
    ``factor`` (the new path's own p G p, which its record must carry), ``outcome`` (a member of
    :class:`.mapping.Outcome`).
    """

    color: mi.Color3f
    jacobian: mi.Float
    factor: mi.Float
    outcome: mi.UInt32


def shift(scope: Scope, path: PathRecord, hit: PrimaryHit, active: mi.Bool) -> Shifted:
    """Shift ``path`` to the pixel whose primary hit is ``hit``.

    Lanes that are not ``active``, or whose path or pixel is empty, come back with color 0.
    """
    kind = kind_of(path)
    present = active & (kind != Kind.EMPTY) & exists(hit.vertex)
    stream = scope.stream(path.name)
    lambdas, response_weight = scope.wavelengths(stream)

    by_hit = kind == Kind.REPLAY_HIT
    by_light = kind == Kind.REPLAY_NEE
    bounces = dr.select(
        by_hit,
        edge_count(path) - 1,
        dr.select(by_light, edge_count(path), reconnection_index(path)) - 2,
    )
    head = at_primary(hit, lambdas, response_weight)
    if scope.mapping.replays:
        head = replay(scope, stream, head, bounces, present)
    else:
        head.outcome = dr.select(bounces == 0, mi.UInt32(Outcome.OK), Outcome.UNCONNECTABLE)
    lost = ~by_hit & ~head.pi.is_valid() & (head.outcome == Outcome.OK)
    outcome = dr.select(lost, Outcome.TERMINATED, head.outcome)
    head.outcome = dr.select(present, outcome, Outcome.EMPTY)

    shifted = _finish(scope, path, head)
    shifted.color = scope.response(shifted.color, lambdas)
    return shifted


def _finish(scope: Scope, path: PathRecord, head: Head) -> Shifted:
    """Complete a replayed prefix by reconnection, by a light sample, or by the light it hit."""
    scene, mapping, kind, outcome = scope.scene, scope.mapping, kind_of(path), head.outcome
    criterion = mapping.criterion
    alive = outcome == Outcome.OK
    by_hit = alive & (kind == Kind.REPLAY_HIT)
    by_light = alive & (kind == Kind.REPLAY_NEE)
    to_environment = alive & (kind == Kind.ENVIRONMENT)
    to_light = alive & (kind == Kind.LIGHT)
    to_vertex = alive & (kind >= Kind.FAR) & ~to_environment
    onward = to_vertex & ~to_light
    extends = alive & ~by_hit

    # ------------------------------ y_h and the direction that leaves it ------------------------

    si = head.pi.compute_surface_interaction(head.ray)
    bsdf = si.bsdf()
    limit = criterion.vertex_limit(si, bsdf, alive)
    arrival = mapping.link(head.start, head.ray, si, limit, head.index, head.footprint)

    light = sample_light(scene, si, path.leaving, False, by_light & can_connect(bsdf))
    seen_k, found = connected(si, path.vertex, to_vertex)
    ray_k, si_k = seen_k.ray, seen_k.si
    direction = dr.select(to_vertex, ray_k.d, dr.select(to_environment, path.wo, light.d))
    value, pdf = evaluate(si, bsdf, direction, extends & (~by_light | light.valid))

    # The pair (y_{h-1}, y_h) must stay unconnectable with the new direction as well, and a path
    # without a reconnection vertex must not find one in the light that ends it.
    connectable = dr.select(by_hit, arrival.reaches, pdf <= arrival.limit)
    outcome = dr.select(alive & connectable, Outcome.INVERTIBILITY, outcome)

    # ------------------------------ x_k seen from y_{k-1} ---------------------------------------

    bsdf_k = si_k.bsdf()
    start = depart(si, direction, pdf, mi.Bool(False), limit)
    limit_k = criterion.vertex_limit(si_k, bsdf_k, onward)
    pair = mapping.link(start, ray_k, si_k, limit_k, reconnection_index(path), head.footprint)
    value_k, pdf_k = evaluate(si_k, bsdf_k, path.wo, onward)
    fits = dr.select(onward, (pdf_k <= pair.limit) & (pdf_k > 0), pair.reaches)
    fits &= found | to_environment
    outcome = dr.select(
        alive & (kind >= Kind.FAR) & (outcome == Outcome.OK) & ~fits, Outcome.UNCONNECTABLE, outcome
    )

    # ------------------------------ emission and MIS --------------------------------------------

    hit_si = dr.select(by_hit, si, si_k)
    hit_origin = dr.select(by_hit, head.start.p, si.p)
    lit = to_light | (by_hit & (si.is_valid() | head.scattered | (not mapping.hides_sky)))
    emitted, emitted_pdf = emission(scene, hit_si, hit_origin, lit)
    emitted_pdf = dr.select(by_hit & head.start.delta, 0, emitted_pdf)
    ends = Ends(kind, value, pdf, value_k, pdf_k, light, emitted, emitted_pdf, head.start.pdf)
    color = head.throughput * ending(path, ends)
    finite = dr.all(dr.isfinite(color))
    outcome = dr.select((outcome == Outcome.OK) & ~finite, Outcome.NOT_FINITE, outcome)
    color = dr.select(outcome == Outcome.OK, color, 0)
    bright = dr.max(dr.abs(color)) > 0
    outcome = dr.select((outcome == Outcome.OK) & ~bright, Outcome.DARK, outcome)

    # ------------------------------ visibility --------------------------------------------------

    shadow = dr.select(
        to_environment,
        si.spawn_ray(direction),
        si.spawn_ray_to(dr.select(to_vertex, seen_k.p, light.p)),
    )
    occluded = scene.ray_test(shadow, extends & (outcome == Outcome.OK))
    outcome = dr.select(occluded, Outcome.OCCLUDED, outcome)

    factor = own_factor(kind, pair, pdf_k)
    # A pdf may underflow. Both directions are refused alike, so nothing is lost on one side only.
    jacobian = factor / path.factor
    sound = (jacobian > 1e-30) & (jacobian < 1e30)
    outcome = dr.select((outcome == Outcome.OK) & ~sound, Outcome.UNCONNECTABLE, outcome)
    defined = outcome == Outcome.OK
    return Shifted(
        dr.select(defined, color, 0),
        dr.select(defined, jacobian, 1),
        factor,
        outcome,
    )
