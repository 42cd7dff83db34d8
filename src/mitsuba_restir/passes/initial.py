"""Initial candidates: path tracing in which every light-carrying sub-path enters one reservoir.

Light sampling and BSDF sampling are combined by the balance heuristic. Where directions come from
and which paths go on is the business of a policy; both are folded into a candidate's resampling
weight, never into its integrand, so that replays need not repeat them.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..guiding.policy import Policy
from ..guiding.roulette import Leaving, no_outlook
from ..guiding.steering import empty_ledger
from ..paths.primary_hit import PrimaryHit
from ..paths.record import Form, form_of
from ..paths.scattering import (
    balance,
    can_connect,
    emission,
    evaluate,
    light_numbers,
    nee_weight,
    sample_light,
)
from ..paths.spectrum import target
from ..paths.vertex import exists, stored
from ..resampling.reservoir import (
    Refused,
    Reservoir,
    Streaming,
    empty_streaming,
    finalize,
    fits,
    is_sound,
    none_refused,
    offer,
    refuse,
)
from ..sampling.streams import FrameKey, PathName, Purpose, uniform
from ..shifts.anchor import Place, no_anchor, onward, record_hit, record_nee
from ..shifts.connectability import depart_scattered
from ..shifts.replay import at_primary
from ..shifts.scope import Scope


@dataclass
class Candidates:
    """What a frame's candidates leave.

    Fields: ``reservoirs``, ``refused`` (what a path tracer would show as well, but no reservoir can
    hold), ``coverage`` (share of the trees that scatter by more than null lobes: alpha), ``cut``
    (whether a tree got as long as paths may be).
    """

    reservoirs: Reservoir
    refused: Refused
    coverage: mi.Float
    cut: mi.Bool


def initial(
    scope: Scope, hit: PrimaryHit, spp: mi.UInt32, policy: Policy, form: Form
) -> Candidates:
    """Resample ``spp`` path trees per pixel into one reservoir of confidence ``spp``.

    Parameters
    ----------
    hit : PrimaryHit
        Primary hits, one lane per pixel.
    spp : UInt32
        Number of trees (opaque).
    policy : Policy
        How the trees grow.
    form : Form
        Of the records.
    """
    confidence = mi.Float(spp) + dr.zeros(mi.Float, scope.grid.size)
    streaming, refused, covered, cut = _trees(scope, hit, spp, policy, form)
    reservoir = finalize(streaming, mi.Float(spp), confidence)
    lost = ~is_sound(reservoir.weight, streaming.total)
    shown = streaming.color * (streaming.total / target(streaming.color))
    refused = refuse(refused, shown, lost)
    refused.color /= mi.Float(spp)
    reservoir.weight = dr.select(lost, 0, reservoir.weight)
    return Candidates(reservoir, refused, covered / mi.Float(spp), cut)


@dr.syntax
def _trees(
    scope: Scope, hit: PrimaryHit, spp: mi.UInt32, policy: Policy, form: Form
) -> tuple[Streaming, Refused, mi.Float, mi.Bool]:
    streaming, refused = empty_streaming(form), none_refused()
    covered, cut = mi.Float(0), mi.Bool(False)
    pixel = scope.grid.pixels()
    tree = mi.UInt32(0)
    while dr.hint(tree < spp, exclude=[scope, policy, form], label="Path trees"):
        name = PathName(pixel, scope.key.sample + tree, scope.key.seed)
        name = name if form.seeded else name.short()
        streaming, refused, scattered, length = _tree(scope, hit, name, policy, streaming, refused)
        covered += dr.select(scattered, mi.Float(1), 0)
        cut |= length == scope.limits.max_depth
        tree += 1
    return streaming, refused, covered, cut


@dr.syntax
def _tree(
    scope: Scope,
    hit: PrimaryHit,
    name: PathName,
    policy: Policy,
    streaming: Streaming,
    refused: Refused,
) -> tuple[Streaming, Refused, mi.Bool, mi.UInt32]:
    """Trace one path tree and stream its sub-paths through the reservoir.

    Also returned: whether it scatters, and the edges of its longest path.
    """
    scene, mapping, limits = scope.scene, scope.mapping, scope.limits
    form = form_of(streaming.path)
    stream = scope.stream(name)
    choices = FrameKey(name.sample, scope.key.seed).stream(Purpose.INITIAL, name.pixel)
    lambdas, response_weight = scope.wavelengths(stream)
    head = at_primary(hit, lambdas, response_weight)
    active = exists(hit.vertex) & (limits.max_depth > 0)

    # ------------------------------ loop state --------------------------------------------------

    ray, pi = head.ray, head.pi  # how the current vertex was found
    throughput = head.throughput  # f cos/p of all bounces so far
    start = head.start  # how the previous vertex was left
    j = head.index  # index of the current vertex
    scattered = head.scattered  # whether any bounce was by more than a null lobe
    survival = mi.Float(1)  # probability of having survived roulette
    eta = mi.Float(1)  # index of refraction relative to the camera
    anchor = no_anchor(form)
    outlook = no_outlook()  # what the path may still find
    ledger = empty_ledger()  # what the choice of directions divides a candidate's weight by

    while dr.hint(active, exclude=[scope, limits, mapping, policy, form], label="Candidates"):
        si = pi.compute_surface_interaction(ray)
        bsdf = si.bsdf()
        limit = mapping.criterion.vertex_limit(si, bsdf, active & si.is_valid())
        arrival = mapping.link(start, ray, si, limit, j, hit.footprint)
        place = Place(name, stream, anchor, arrival, stored(pi, si.p, form.compact), j)
        anchored = anchor.k != 0

        # -------------------------- light found by the last bounce ------------------------------

        arrived = active & (j > 1)
        arrived &= si.is_valid() | scattered | (not mapping.hides_sky)
        radiance, light_pdf = emission(scene, si, start.p, arrived)
        light_pdf = dr.select(start.delta, 0, light_pdf)
        path, kept = record_hit(place, start, ray.d, radiance, light_pdf, si.is_valid())
        color = scope.response(
            throughput * radiance * balance(start.pdf, light_pdf) * kept, lambdas
        )
        odds = ledger.inverse(anchored | arrival.reaches) / survival
        weight = target(color) * odds
        refused = refuse(refused, color * odds, arrived & ~fits(streaming, weight))
        streaming = offer(streaming, path, color, weight, uniform(choices, j, 0), arrived)
        found = scope.response(radiance * balance(start.pdf, light_pdf), lambdas)
        found = dr.select(arrived, target(found), 0)
        outlook = policy.roulette.arrive(outlook, si, j, found, active)

        # -------------------------- light sampled from this vertex ------------------------------

        on_surface = active & si.is_valid()
        active = on_surface & (j < limits.max_depth)
        lit = active & can_connect(bsdf)
        numbers = light_numbers(stream, j)
        light = sample_light(scene, si, numbers, True, lit)
        value, pdf = evaluate(si, bsdf, light.d, light.valid)
        light_pdf = dr.select(light.delta, 0, light.pdf)
        mis = nee_weight(light_pdf, pdf)
        path, kept = record_nee(place, light, numbers, pdf, value * mis, light_pdf)
        color = scope.response(throughput * value * light.weight * mis * kept, lambdas)
        odds = ledger.inverse(anchored | (pdf <= arrival.limit)) / survival
        weight = target(color) * odds
        refused = refuse(refused, color * odds, light.valid & ~fits(streaming, weight))
        streaming = offer(streaming, path, color, weight, uniform(choices, j, 1), light.valid)

        # -------------------------- next bounce -------------------------------------------------

        # The lobe of the last vertex counts as well, as long as it is not known to cover anything.
        leaves = active | (on_surface & ~scattered)
        bounce, factors = policy.steering.bounce(si, stream, choices, j, leaves, ledger)
        scattered |= on_surface & ~bounce.null
        anchor = onward(place, bounce)
        ledger = ledger.after(anchor.k != 0, factors)
        # A guided bounce that a replay would have to repeat leads to no candidate.
        active &= ledger.settled > 0
        sampled = scope.response(value * light.weight * mis, lambdas)
        worth = target(scope.response(throughput, lambdas)) / (survival * ledger.settled)
        step = target(scope.response(bounce.weight, lambdas)) / factors.stored
        throughput *= bounce.weight
        eta *= bounce.eta
        start = depart_scattered(si, bounce, limit)

        brightest = dr.max(throughput) / survival
        sampled = dr.select(light.valid, target(sampled), 0)
        leaving = Leaving(j, sampled, worth, step, brightest, eta)
        chance, outlook = policy.roulette.leave(outlook, leaving, active)
        active &= (brightest != 0) & (bounce.roulette < chance)
        survival *= chance

        ray = si.spawn_ray(bounce.wo)
        pi = scene.ray_intersect_preliminary(ray, coherent=False, active=active)
        j += 1

    return streaming, refused, scattered, j - 1
