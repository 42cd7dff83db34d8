"""Perturbations: the same path with another reconnection vertex, in the same pixel.

Everything before x_{k-1} and after x_{k+1} stays. Which factors of the path's density change, and
with them the Jacobian of the move in primary sample space, depends on what follows x_k:

    FAR          p(x_k -> x_{k+1}) G(x_k, x_{k+1}) p(x_{k+1} -> x_{k+2}), without the last where
                 the light is sampled from x_{k+1}
    NEE          none (the light's random numbers stay)
    HIT          p(x_k -> light) G(x_k, light), without G for the environment
    LIGHT, ENVIRONMENT, REPLAY_NEE    none

The source is Sawhney et al. 2024, section 4, written for a direction-space proposal: instead of the
random numbers of x_{k-1} its direction is perturbed, and p(x_{k-1} -> x_k) joins the factors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi

from ..paths.packing import pack_direction, pack_radiance
from ..paths.record import (
    Kind,
    PathRecord,
    continuation_of,
    kind_of,
    next_kind_of,
    reconnection_index,
    rounding,
)
from ..paths.scattering import (
    balance,
    can_connect,
    emission,
    evaluate,
    light_numbers,
    nee_weight,
    sample_light,
)
from ..paths.vertex import Stored, connection, exists
from ..shifts.connectability import depart
from ..shifts.ending import Ends, ending, own_factor
from ..shifts.scope import Scope
from .kind import State
from .pivot import Pivot

CHANGES: tuple[str, ...] = ("vertex", "leaving", "arriving", "light_pdf", "factor")
"""Fields of a path's record that differ when its reconnection vertex does."""


@dataclass
class Landing:
    """The reconnection vertex that a path is to have.

    Fields: ``vertex``, ``si`` (invalid for the environment), ``ray`` (from the pivot to it).
    """

    vertex: Stored
    si: mi.SurfaceInteraction3f
    ray: mi.Ray3f


def at_vertex(
    scope: Scope, pivot: Pivot, path: PathRecord, landing: Landing, active: mi.Bool
) -> tuple[State, mi.Ray3f, mi.Bool]:
    """The path with another reconnection vertex, visibility of what follows it left open.

    Parameters
    ----------
    path : PathRecord
        The path to be changed (a ``REPLAY_NEE`` path carries the light's new numbers already).
    landing : Landing
        The new x_k.

    Returns
    -------
    state : State
        Color 0 where the move leaves the set on which the chain is defined.
    shadow : Ray3f
        The segment that must be unoccluded.
    tested : Bool
        Lanes that have one.
    """
    scene, mapping, si_k, ray = scope.scene, scope.mapping, landing.si, landing.ray
    kind, k, following = kind_of(path), reconnection_index(path), continuation_of(path)
    far, nee, hit = kind == Kind.FAR, kind == Kind.NEE, kind == Kind.HIT
    by_numbers = kind == Kind.REPLAY_NEE
    onward = active & (far | nee | hit)
    ahead = active & (far | hit) & exists(following.vertex)
    bsdf, bsdf_k = pivot.si.bsdf(), si_k.bsdf()

    # ------------------------------ light samples and x_{k-1} -> x_k ----------------------------

    numbers = dr.select(by_numbers, path.leaving, light_numbers(pivot.stream, k))
    sampled = active & dr.select(by_numbers, can_connect(bsdf), nee & can_connect(bsdf_k))
    light = sample_light(scene, dr.select(by_numbers, pivot.si, si_k), numbers, False, sampled)
    direction = dr.select(by_numbers, light.d, ray.d)
    value, pdf = evaluate(pivot.si, bsdf, direction, active & (~by_numbers | light.valid))
    start = depart(pivot.si, direction, pdf, mi.Bool(False), pivot.limit)
    limit_k = mapping.criterion.vertex_limit(si_k, bsdf_k, onward)
    pair = mapping.link(start, ray, si_k, limit_k, k, pivot.footprint)

    # ------------------------------ x_k -> x_{k+1} ----------------------------------------------

    ray_n, distance_n, reached = connection(si_k, pivot.next_si.p)
    si_n = mi.SurfaceInteraction3f(pivot.next_si)
    si_n.wi = pivot.next_si.to_local(-ray_n.d)
    wo = dr.select(nee, light.d, dr.select(ahead, ray_n.d, path.wo))
    value_k, pdf_k = evaluate(si_k, bsdf_k, wo, onward)
    value_n, pdf_n = evaluate(si_n, si_n.bsdf(), following.wo, ahead & far)
    geometry = dr.abs(dr.dot(si_n.n, ray_n.d)) / dr.square(distance_n)

    # The pair before the pivot must stay unconnectable with the new direction, and x_k connectable.
    defined = active & ~(pdf <= pivot.arrival.limit) & (~ahead | reached)
    defined &= by_numbers | dr.select(onward, (pdf_k <= pair.limit) & (pdf_k > 0), pair.reaches)

    # ------------------------------ what arrives ------------------------------------------------

    found = active & ((kind == Kind.LIGHT) | (kind == Kind.ENVIRONMENT))
    emitted, emitted_pdf = emission(
        scene,
        dr.select(hit, si_n, si_k),
        dr.select(hit, si_k.p, pivot.si.p),
        found | (hit & ahead),
    )
    renewed = found | (hit & ahead)
    radiance = dr.select(far, _through(path, value_n, pdf_n), light.weight)
    radiance = dr.select(renewed, emitted, radiance)
    arriving = pack_radiance(radiance, rounding(pivot.stream, path.info, False))
    light_pdf = dr.select(nee, dr.select(light.delta, 0, light.pdf), path.light_pdf)
    light_pdf = dr.select(renewed, emitted_pdf, light_pdf)
    to_environment = kind == Kind.ENVIRONMENT
    leaving = pack_direction(dr.select(to_environment, direction, wo))
    moved = replace(
        path,
        vertex=landing.vertex,
        leaving=dr.select(to_environment | onward, leaving, path.leaving),
        arriving=dr.select(far | nee | renewed, arriving, path.arriving),
        light_pdf=light_pdf,
        factor=own_factor(kind, pair, pdf_k),
    )
    ends = Ends(kind, value, pdf, value_k, pdf_k, light, emitted, emitted_pdf, mi.Float(0))
    color = scope.response(pivot.throughput * ending(moved, ends), pivot.lambdas)

    density = dr.select(by_numbers, 1, pdf)
    density *= dr.select(far | hit, pdf_k * dr.select(ahead, geometry, 1), 1)
    density *= dr.select(far & (next_kind_of(path) != Kind.NEE), pdf_n, 1)

    # ------------------------------ visibility --------------------------------------------------

    end = dr.select(ahead, pivot.next_si.p, light.p)
    shadow = dr.select(
        by_numbers,
        pivot.si.spawn_ray_to(end),
        dr.select(hit & ~ahead, si_k.spawn_ray(wo), si_k.spawn_ray_to(end)),
    )
    color = dr.select(defined & (density > 0), color, 0)
    state = State(moved, color, density, direction, pdf, si_k.p, si_k.n)
    return state, shadow, onward | (active & by_numbers)


def _through(path: PathRecord, value: mi.Spectrum, pdf: mi.Float) -> mi.Spectrum:
    """Light that a ``FAR`` path sends from x_{k+1} to x_k, by its kind as seen from x_{k+1}."""
    kind, following = next_kind_of(path), continuation_of(path)
    scattered = dr.select(pdf > 0, value / pdf, 0) * following.radiance
    scattered = dr.select(
        kind == Kind.HIT, scattered * balance(pdf, following.light_pdf), scattered
    )
    return dr.select(
        kind == Kind.NEE,
        value * following.radiance * nee_weight(following.light_pdf, pdf),
        scattered,
    )
