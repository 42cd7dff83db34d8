"""Initial candidates: path tracing in which every light-carrying sub-path enters one reservoir.

Light sampling and BSDF sampling are combined by the balance heuristic. Russian roulette follows
Mitsuba's ``path`` and is folded into a candidate's resampling weight, never into its integrand, so
that replays need not repeat it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi

from ..paths import record as kinds
from ..paths.primary_hit import PrimaryHit
from ..paths.record import Absent, Continuation, PathRecord, pack_info
from ..paths.scattering import (
    LightSample,
    Scattered,
    balance,
    can_connect,
    emission,
    evaluate,
    light_numbers,
    nee_weight,
    sample_light,
    scatter,
)
from ..paths.settings import PathLimits
from ..paths.spectrum import response, target, wavelengths
from ..paths.vertex import Vertex, compact, exists, no_vertex
from ..resampling.reservoir import Reservoir, empty_reservoir, finalize, offer
from ..sampling.streams import INITIAL, Stream, pass_stream, path_stream, uniform
from ..shifts.connectability import Departure, Link, depart_scattered, link
from ..shifts.mapping import ShiftMapping
from ..shifts.replay import at_primary


@dataclass
class Anchor:
    """The reconnection vertex that a growing path has found, if ``k`` is not 0.

    Fields: ``k``, ``vertex`` (x_k), ``wo`` (direction leaving it), ``jacobian`` (p_{k-1} G p_k),
    ``suffix`` (``Spectrum``, throughput of the bounces after x_k's own), ``next``
    (:class:`Follower`, or :class:`Absent` where records need no continuation).
    """

    k: Any
    vertex: Vertex
    wo: Any
    jacobian: Any
    suffix: Any
    next: Follower | Absent


@dataclass
class Follower:
    """The vertex after the reconnection vertex.

    Fields: ``vertex`` (x_{k+1}), ``wo`` (direction leaving it), ``delta`` (by a delta lobe),
    ``suffix`` (``Spectrum``, throughput of the bounces after x_{k+1}'s own).
    """

    vertex: Vertex
    wo: Any
    delta: Any
    suffix: Any


@dataclass
class _Name:
    """The three words that name a path's stream, and the stream."""

    pixel: Any
    sample: Any
    seed: Any
    stream: Stream


def initial(
    scene: mi.Scene,
    sensor: mi.Sensor,
    hit: PrimaryHit,
    sample: Any,
    seed: Any,
    spp: Any,
    limits: PathLimits,
    mapping: ShiftMapping,
    continued: bool,
) -> Reservoir:
    """Resample ``spp`` path trees per pixel into one reservoir of confidence ``spp``.

    Parameters
    ----------
    hit : PrimaryHit
        Primary hits, one lane per pixel.
    sample, seed, spp : UInt32
        Running number of the frame's first sample, the user's seed, number of trees (opaque).
    continued : bool
        Whether records carry the continuation that mutations need.
    """
    pixel = dr.arange(mi.UInt32, dr.width(hit.vertex.p))
    reservoir = _trees(scene, sensor, hit, pixel, sample, seed, spp, limits, mapping, continued)
    reservoir = finalize(reservoir, mi.Float(spp))
    reservoir.confidence = mi.Float(spp) + dr.zeros(mi.Float, dr.width(pixel))
    return reservoir


@dr.syntax
def _trees(
    scene: mi.Scene,
    sensor: mi.Sensor,
    hit: PrimaryHit,
    pixel: Any,
    sample: Any,
    seed: Any,
    spp: Any,
    limits: PathLimits,
    mapping: ShiftMapping,
    continued: bool,
) -> Reservoir:
    reservoir = empty_reservoir(continued)
    tree = mi.UInt32(0)
    while dr.hint(tree < spp, exclude=[limits, mapping], label="Path trees"):
        reservoir = _tree(
            scene, sensor, hit, pixel, sample + tree, seed, reservoir, limits, mapping
        )
        tree += 1
    return reservoir


@dr.syntax
def _tree(
    scene: mi.Scene,
    sensor: mi.Sensor,
    hit: PrimaryHit,
    pixel: Any,
    sample: Any,
    seed: Any,
    reservoir: Reservoir,
    limits: PathLimits,
    mapping: ShiftMapping,
) -> Reservoir:
    """Trace one path tree and stream its sub-paths through ``reservoir``."""
    criterion = mapping.criterion
    name = _Name(pixel, sample, seed, path_stream(pixel, sample, seed, mapping.dither))
    choices = pass_stream(INITIAL, pixel, sample, seed)
    lambdas, response_weight = wavelengths(sensor, name.stream)
    head = at_primary(hit, lambdas, response_weight)
    active = exists(hit.vertex) & (limits.max_depth > 1)

    # ------------------------------ loop state --------------------------------------------------

    ray, pi = head.ray, head.pi  # how the current vertex was found
    throughput = head.throughput  # f cos/p of all bounces so far
    start = head.start  # how the previous vertex was left
    j = head.index  # index of the current vertex
    survival = mi.Float(1)  # probability of having survived roulette
    eta = mi.Float(1)  # index of refraction relative to the camera
    anchor = Anchor(
        mi.UInt32(0),
        no_vertex(),
        dr.zeros(mi.Vector3f),
        mi.Float(1),
        mi.Spectrum(1),
        Absent() if isinstance(reservoir.path.next, Absent) else _no_follower(),
    )

    while dr.hint(active, exclude=[limits, mapping, criterion], label="Initial candidates"):
        si = pi.compute_surface_interaction(ray)
        bsdf = si.bsdf()
        limit = criterion.vertex_limit(si, bsdf, active & si.is_valid())
        arrival = link(criterion, start, si, limit, j, mapping.last_index, hit.footprint)
        here = compact(pi, si.p)

        # -------------------------- light found by the last bounce ------------------------------

        arrived = active & (j > 1)
        radiance, light_pdf = emission(scene, si, start.p, arrived)
        light_pdf = dr.select(start.delta, 0, light_pdf)
        path = _hit_record(
            name, anchor, arrival, here, si.is_valid(), ray.d, radiance, light_pdf, start, j
        )
        color = response(throughput * radiance * balance(start.pdf, light_pdf), lambdas)
        u = uniform(choices, j, 0)
        reservoir = offer(reservoir, path, color, target(color) / survival, u, arrived)

        # -------------------------- light sampled from this vertex ------------------------------

        active &= si.is_valid() & (j < limits.max_depth)
        lit = active & can_connect(bsdf)
        numbers = light_numbers(name.stream, j)
        light = sample_light(scene, si, numbers, True, lit)
        value, pdf = evaluate(si, bsdf, light.d, light.valid)
        light_pdf = dr.select(light.delta, 0, light.pdf)
        mis = nee_weight(light_pdf, pdf)
        path = _nee_record(
            name, anchor, arrival, here, light, numbers, pdf, value * mis, light_pdf, j
        )
        color = response(throughput * value * light.weight * mis, lambdas)
        u = uniform(choices, j, 1)
        reservoir = offer(reservoir, path, color, target(color) / survival, u, light.valid)

        # -------------------------- next bounce -------------------------------------------------

        bounce = scatter(si, bsdf, name.stream, j, active)
        free = ~bounce.delta & (bounce.pdf <= arrival.limit)
        anchor = dr.select(
            (anchor.k == 0) & free,
            Anchor(j, here, bounce.wo, arrival.jacobian * bounce.pdf, mi.Spectrum(1), anchor.next),
            _extend(anchor, here, bounce, j),
        )
        throughput *= bounce.weight
        eta *= bounce.eta
        start = depart_scattered(si, bounce, limit)

        brightest = dr.max(throughput) / survival
        chance = dr.minimum(brightest * dr.square(eta), 0.95)
        roulette = j >= limits.rr_depth
        active &= (brightest > 0) & (~roulette | (bounce.roulette < chance))
        survival *= dr.select(roulette, chance, 1)

        ray = si.spawn_ray(bounce.wo)
        pi = scene.ray_intersect_preliminary(ray, coherent=False, active=active)
        j += 1

    return reservoir


def _no_follower() -> Follower:
    return Follower(no_vertex(), dr.zeros(mi.Vector3f), mi.Bool(False), mi.Spectrum(1))


def _extend(anchor: Anchor, here: Vertex, bounce: Scattered, j: Any) -> Anchor:
    """The anchor after one more bounce, from the vertex ``here`` with index ``j``."""
    anchored = anchor.k != 0
    follower = anchor.next
    if isinstance(follower, Follower):
        follower = dr.select(
            anchored & (anchor.k + 1 == j),
            Follower(here, bounce.wo, bounce.delta, mi.Spectrum(1)),
            replace(follower, suffix=follower.suffix * bounce.weight),
        )
    suffix = dr.select(anchored, anchor.suffix * bounce.weight, 1)
    return replace(anchor, suffix=suffix, next=follower)


def _hit_record(
    name: _Name,
    anchor: Anchor,
    arrival: Link,
    here: Vertex,
    on_surface: Any,
    direction: Any,
    radiance: Any,
    light_pdf: Any,
    start: Departure,
    j: Any,
) -> PathRecord:
    """Record of the path whose last bounce found the light at x_j."""
    anchored = anchor.k != 0
    from_anchor = anchored & (anchor.k + 1 == j)
    to_light = ~anchored & arrival.reaches
    mis = balance(start.pdf, light_pdf)
    kind = dr.select(
        anchored,
        dr.select(from_anchor, mi.UInt32(kinds.HIT), kinds.FAR),
        dr.select(
            arrival.reaches,
            dr.select(on_surface, mi.UInt32(kinds.LIGHT), kinds.ENVIRONMENT),
            kinds.REPLAY_HIT,
        ),
    )
    next_kind = mi.UInt32(kinds.EMPTY)
    continuation: Continuation | Absent = Absent()
    if isinstance(anchor.next, Follower):
        second = anchor.k + 2 == j
        found = dr.select(second, mi.UInt32(kinds.HIT), kinds.FAR)
        next_kind = dr.select(anchored & ~from_anchor & ~anchor.next.delta, found, next_kind)
        continuation = Continuation(
            dr.select(from_anchor, dr.select(on_surface, here, no_vertex()), anchor.next.vertex),
            anchor.next.wo,
            dr.select(second, radiance, anchor.next.suffix * radiance * mis),
            light_pdf,
        )
    return PathRecord(
        name.pixel,
        name.sample,
        name.seed,
        pack_info(
            kind, False, dr.select(anchored, anchor.k, dr.select(to_light, j, 0)), j, next_kind
        ),
        dr.select(anchored, anchor.vertex, dr.select(to_light & on_surface, here, no_vertex())),
        dr.select(anchored, anchor.wo, direction),
        dr.select(anchored & ~from_anchor, anchor.suffix * radiance * mis, radiance),
        light_pdf,
        dr.select(anchored, anchor.jacobian, dr.select(to_light, arrival.jacobian, 1)),
        continuation,
    )


def _nee_record(
    name: _Name,
    anchor: Anchor,
    arrival: Link,
    here: Vertex,
    light: LightSample,
    numbers: Any,
    pdf: Any,
    scattered: Any,
    light_pdf: Any,
    j: Any,
) -> PathRecord:
    """Record of the path that ends in a light sampled from x_j."""
    anchored = anchor.k != 0
    from_here = ~anchored & (pdf <= arrival.limit)
    kind = dr.select(
        anchored,
        mi.UInt32(kinds.FAR),
        dr.select(from_here, mi.UInt32(kinds.NEE), kinds.REPLAY_NEE),
    )
    next_kind = mi.UInt32(kinds.EMPTY)
    continuation: Continuation | Absent = Absent()
    if isinstance(anchor.next, Follower):
        second = anchor.k + 1 == j
        next_kind = dr.select(
            second,
            mi.UInt32(kinds.NEE),
            dr.select(anchor.next.delta, mi.UInt32(kinds.EMPTY), kinds.FAR),
        )
        next_kind = dr.select(anchored, next_kind, kinds.EMPTY)
        continuation = Continuation(
            dr.select(second, here, anchor.next.vertex),
            dr.select(second, light.d, anchor.next.wo),
            dr.select(second, light.weight, anchor.next.suffix * scattered * light.weight),
            light_pdf,
        )
    # A light sampled before any reconnection vertex is described by the numbers that sampled it.
    leaving = dr.select(from_here, light.d, mi.Vector3f(numbers.x, numbers.y, 0))
    return PathRecord(
        name.pixel,
        name.sample,
        name.seed,
        pack_info(
            kind,
            True,
            dr.select(anchored, anchor.k, dr.select(from_here, j, 0)),
            j + 1,
            next_kind,
        ),
        dr.select(anchored, anchor.vertex, dr.select(from_here, here, no_vertex())),
        dr.select(anchored, anchor.wo, leaving),
        dr.select(anchored, anchor.suffix * scattered * light.weight, light.weight),
        light_pdf,
        dr.select(anchored, anchor.jacobian, dr.select(from_here, arrival.jacobian, 1)),
        continuation,
    )
