"""The one tracer: scatter at a vertex, follow the ray, connect to a light, find emission.

Initial sampling, replay and suffix re-tracing all call these functions, so that a replayed path
takes the same branches and hits the same triangles as the path that it repeats.

Every factor is the whole BSDF's: a non-delta direction is evaluated with ``eval_pdf`` whatever lobe
it was drawn from, so that a path has the same integrand f/p however its direction came about. A
delta (or null) direction keeps the weight that ``bsdf.sample`` returned.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..sampling import streams


@dataclass
class Scattered:
    """A sampled bounce: direction ``wo`` (world), ``weight`` f cos/p, ``pdf``, ``delta``, ``eta``.

    ``null`` is a bounce that goes straight on, as if the surface were not there (also ``delta``).
    ``roulette`` is the block's spare uniform number, used for Russian roulette.
    """

    wo: mi.Vector3f
    weight: mi.Spectrum
    pdf: mi.Float
    delta: mi.Bool
    null: mi.Bool
    eta: mi.Float
    roulette: mi.Float


@dataclass
class LightSample:
    """A light sampled from a vertex: direction ``d``, point ``p``, solid-angle ``pdf``, ``delta``.

    ``weight`` is emitted radiance over pdf, without visibility unless it was asked for.
    """

    d: mi.Vector3f
    p: mi.Point3f
    pdf: mi.Float
    delta: mi.Bool
    weight: mi.Spectrum
    valid: mi.Bool


def scatter(
    si: mi.SurfaceInteraction3f,
    bsdf: mi.BSDFPtr,
    stream: streams.Stream,
    vertex: mi.UInt32,
    active: mi.Bool,
) -> Scattered:
    """Sample the direction that the path ``stream`` takes at its ``vertex``-th vertex ``si``."""
    context = mi.BSDFContext()
    lobe, roulette = streams.uniform2(stream, vertex, streams.LOBE)
    direction = mi.Point2f(*streams.uniform2(stream, vertex, streams.DIRECTION))
    sample, weight = bsdf.sample(context, si, lobe, direction, active)
    delta = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)
    value, pdf = bsdf.eval_pdf(context, si, sample.wo, active & ~delta)
    sampled = sample.pdf > 0
    return Scattered(
        wo=si.to_world(sample.wo),
        weight=dr.select(
            sampled & delta, weight, dr.select(sampled & (pdf > 0), value / pdf, mi.Spectrum(0))
        ),
        pdf=dr.select(delta, sample.pdf, pdf),
        delta=delta,
        null=mi.has_flag(sample.sampled_type, mi.BSDFFlags.Null),
        eta=sample.eta,
        roulette=roulette,
    )


def sample_light(
    scene: mi.Scene,
    si: mi.SurfaceInteraction3f,
    u: mi.Point2f,
    test_visibility: bool,
    active: mi.Bool,
) -> LightSample:
    """Sample a light from ``si`` with the two numbers ``u``; the same numbers repeat the sample."""
    ds, weight = scene.sample_emitter_direction(si, u, test_visibility, active)
    valid = active & (ds.pdf > 0)
    return LightSample(ds.d, ds.p, ds.pdf, ds.delta, weight, valid)


def light_numbers(stream: streams.Stream, vertex: mi.UInt32) -> mi.Point2f:
    """The numbers with which a path samples a light from its ``vertex``-th vertex."""
    return mi.Point2f(*streams.uniform2(stream, vertex, streams.LIGHT))


def evaluate(
    si: mi.SurfaceInteraction3f, bsdf: mi.BSDFPtr, direction: mi.Vector3f, active: mi.Bool
) -> tuple[mi.Spectrum, mi.Float]:
    """BSDF times cosine and its sampling pdf [1/sr] for a world-space ``direction``."""
    return bsdf.eval_pdf(mi.BSDFContext(), si, si.to_local(direction), active)


def along(
    si: mi.SurfaceInteraction3f, bsdf: mi.BSDFPtr, direction: mi.Vector3f, active: mi.Bool
) -> Scattered:
    """The bounce along a given world-space ``direction``, as if it had been sampled."""
    value, pdf = evaluate(si, bsdf, direction, active)
    weight = dr.select(pdf > 0, value / pdf, mi.Spectrum(0))
    no = mi.Bool(False)
    return Scattered(direction, weight, pdf, no, no, mi.Float(1), mi.Float(0))


def can_connect(bsdf: mi.BSDFPtr) -> mi.Bool:
    """Lanes whose BSDF has anything but delta lobes."""
    return mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)


def emission(
    scene: mi.Scene, si: mi.SurfaceInteraction3f, origin: mi.Point3f, active: mi.Bool
) -> tuple[mi.Spectrum, mi.Float]:
    """Radiance that a ray from the point ``origin`` receives at ``si``, and its light-sampling pdf.

    Returns
    -------
    radiance : Spectrum
        Emitted radiance (an invalid ``si`` is the environment).
    pdf : Float
        Solid-angle density [1/sr] of finding ``si`` by sampling lights from ``origin``.
    """
    reference = dr.zeros(mi.Interaction3f)
    reference.p = origin
    ds = mi.DirectionSample3f(scene, si, reference)
    emitter = si.emitter(scene, active)
    active = active & (emitter != None)  # noqa: E711  (element-wise comparison of pointers)
    radiance = emitter.eval(si, active)
    return radiance, scene.pdf_emitter_direction(reference, ds, active)


def balance(pdf: mi.Float, other: mi.Float) -> mi.Float:
    """Balance heuristic (Veach 1997) of the technique with density ``pdf``; 0 where both vanish."""
    total = pdf + other
    return dr.select(total > 0, pdf / total, 0)


def nee_weight(light_pdf: mi.Float, scatter_pdf: mi.Float) -> mi.Float:
    """MIS weight of a light sample; ``light_pdf`` 0 marks a delta light (weight 1)."""
    return dr.select(light_pdf > 0, balance(light_pdf, scatter_pdf), 1)
