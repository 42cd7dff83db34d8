"""The suffix of a stored path, traced again with the path's own numbers in the scene as it is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi

from ..paths.packing import keep_radiance, pack_direction, pack_radiance
from ..paths.primary_hit import PrimaryHit
from ..paths.record import (
    Continuation,
    Kind,
    PathRecord,
    edge_count,
    ends_by_nee,
    kind_of,
    next_kind_of,
    reconnection_index,
    rounding,
)
from ..paths.scattering import (
    along,
    balance,
    can_connect,
    emission,
    evaluate,
    light_numbers,
    nee_weight,
    sample_light,
    scatter,
)
from ..paths.vertex import Spot, displaced, sight, stored
from .scope import Scope


@dataclass
class Suffix:
    """A path with its suffix traced again.

    Fields: ``path``; ``kept_pdf`` (density [1/sr] with which x_{k+1} scatters into the direction
    that the record's continuation has kept; 1 where none is kept).
    """

    path: PathRecord
    kept_pdf: mi.Float


@dr.syntax
def retrace_suffix(scope: Scope, path: PathRecord, hit: PrimaryHit, active: mi.Bool) -> Suffix:
    """Trace everything after x_k again with the path's own numbers.

    Parameters
    ----------
    hit : PrimaryHit
        From which x_k is looked at; which one does not matter where surfaces are two-sided.
    """
    scene = scope.scene
    stream = scope.stream(path.name)
    lambdas, _ = scope.wavelengths(stream)
    kind, k, d = kind_of(path), reconnection_index(path), edge_count(path)
    by_nee = ends_by_nee(path)
    from_vertex = active & (kind >= Kind.FAR) & (kind <= Kind.HIT)

    # Where the geometry moved, a vertex of a mesh moves with it.
    si_k = sight(path.vertex, lambda _: hit.vertex.p, lambdas, active).si
    moved = displaced(path.vertex, lambda p: dr.select(si_k.is_valid(), si_k.p, p))

    # ------------------------------ light sampled from x_k --------------------------------------

    sampled = from_vertex & (kind == Kind.NEE)
    light = sample_light(scene, si_k, light_numbers(stream, k), True, sampled)

    # ------------------------------ light found along the stored direction ----------------------

    to_environment = active & (kind == Kind.ENVIRONMENT)
    ray = si_k.spawn_ray(path.wo)
    pi = scene.ray_intersect_preliminary(ray, coherent=False, active=from_vertex & ~sampled)
    origin = dr.select(to_environment, hit.vertex.p, si_k.p)
    si = pi.compute_surface_interaction(ray)
    found = to_environment | (from_vertex & (kind == Kind.HIT))
    emitted, light_pdf = emission(scene, si, origin, found)

    # ------------------------------ longer suffixes ---------------------------------------------

    walking = from_vertex & (kind == Kind.FAR) & pi.is_valid()
    after = stored(pi, si.p, isinstance(path.vertex, Spot))  # x_{k+1}
    after_wo = mi.Vector3f(path.wo)  # direction leaving it
    j = k + 1
    throughput = mi.Spectrum(1)  # of the bounces after x_k
    beyond = mi.Spectrum(1)  # of the bounces after x_{k+1}
    radiance = mi.Spectrum(0)  # arriving at x_k
    after_radiance = mi.Spectrum(0)  # arriving at x_{k+1}
    after_pdf = mi.Float(0)
    start = mi.Point3f(si_k.p)
    pdf = mi.Float(0)
    delta = mi.Bool(False)
    kept_pdf = mi.Float(1)

    while dr.hint(walking, label="Temporal retrace"):
        si_j = pi.compute_surface_interaction(ray)
        bsdf = si_j.bsdf()
        first = j == k + 1

        last = walking & ~by_nee & (j == d)
        emitted_j, pdf_j = emission(scene, si_j, start, last)
        pdf_j = dr.select(delta, 0, pdf_j)
        arriving = emitted_j * balance(pdf, pdf_j)
        radiance = dr.select(last, throughput * arriving, radiance)
        after_radiance = dr.select(
            last, dr.select(j == k + 2, emitted_j, beyond * arriving), after_radiance
        )
        after_pdf = dr.select(last, pdf_j, after_pdf)
        walking &= ~last & si_j.is_valid()

        numbers = light_numbers(stream, j)
        ends_here = walking & by_nee & (j + 1 == d)
        light_j = sample_light(scene, si_j, numbers, True, ends_here & can_connect(bsdf))
        lit = ends_here & light_j.valid
        value, nee_pdf = evaluate(si_j, bsdf, light_j.d, lit)
        pdf_j = dr.select(light_j.delta, 0, light_j.pdf)
        arriving = value * light_j.weight * nee_weight(pdf_j, nee_pdf)
        radiance = dr.select(lit, throughput * arriving, radiance)
        after_radiance = dr.select(
            lit, dr.select(first, light_j.weight, beyond * arriving), after_radiance
        )
        after_pdf = dr.select(lit, pdf_j, after_pdf)
        after_wo = dr.select(lit & first, light_j.d, after_wo)
        walking &= ~ends_here

        bounce = scatter(si_j, bsdf, stream, j, walking)
        if isinstance(path.next, Continuation):
            # A mutation of x_k has changed what the random numbers of x_{k+1} would do.
            kept = walking & first & (next_kind_of(path) != Kind.EMPTY)
            bounce = dr.select(kept, along(si_j, bsdf, path.next.wo, kept), bounce)
            kept_pdf = dr.select(kept, bounce.pdf, kept_pdf)
            # What a delta lobe has chosen is not kept, and must be what a delta lobe chooses again.
            walking &= ~first | kept | bounce.delta
        throughput *= bounce.weight
        beyond = dr.select(first, mi.Spectrum(1), beyond * bounce.weight)
        after_wo = dr.select(walking & first, bounce.wo, after_wo)
        pdf, delta = bounce.pdf, bounce.delta
        start = mi.Point3f(si_j.p)
        ray = si_j.spawn_ray(bounce.wo)
        walking &= dr.max(dr.abs(throughput)) > 0
        pi = scene.ray_intersect_preliminary(ray, coherent=False, active=walking)
        j += 1

    radiance = dr.select(found, emitted, dr.select(sampled, light.weight, radiance))
    sampled_pdf = dr.select(light.delta, 0, light.pdf)
    following = path.next
    if isinstance(following, Continuation):
        there, left = keep_radiance(after_radiance, rounding(stream, path.info, True))
        # What arrives follows from what is kept, as when the path was found.
        radiance = dr.select(kind == Kind.FAR, radiance * left, radiance)
        following = dr.select(
            from_vertex & ~sampled,
            Continuation(after, pack_direction(after_wo), there, after_pdf),
            following,
        )
    arriving = pack_radiance(radiance, rounding(stream, path.info, False))
    traced = replace(
        path,
        vertex=moved,
        leaving=dr.select(sampled, pack_direction(light.d), path.leaving),
        arriving=dr.select(from_vertex | to_environment, arriving, path.arriving),
        light_pdf=dr.select(found, light_pdf, dr.select(sampled, sampled_pdf, path.light_pdf)),
        next=following,
    )
    return Suffix(traced, kept_pdf)
