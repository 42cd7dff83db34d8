"""Decorrelation: Metropolis-Hastings mutations of every pixel's path, between the two reuse passes.

Sawhney et al. 2024. A mutation moves the reconnection vertex; its stationary density is the target
function, so the path stays a sample of it and W' = W C(x)/C(y) keeps its contribution unbiased. The
luminance of F W is the same before and after: only neighbours, later frames and the colour see a
mutation.

The proposal perturbs the direction that leaves x_{k-1} by a von Mises-Fisher lobe around it, with a
concentration proportional to the BSDF pdf: in primary sample space that is a step of constant size,
without inverting the BSDF's sampling routine. The lobe's ratio is part of the acceptance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi

from ..paths import record as kinds
from ..paths.primary_hit import PrimaryHit
from ..paths.record import PathRecord, kind_of
from ..paths.spectrum import target
from ..paths.vertex import compact, seen_from
from ..resampling.reservoir import Reservoir
from ..sampling.streams import MUTATION, pass_stream, uniform, uniform2
from ..shifts.mapping import ShiftMapping
from ..shifts.perturb import State, at_vertex, next_interaction
from ..shifts.pivot import Pivot, movable, mutation_class, pivot_of

Acceptance = Callable[[State, State, Any], Any]
"""Acceptance rule: (current state, proposed state, T(y->x)/T(x->y)) -> probability (``Float``)."""


@dataclass
class Mutated:
    """What the mutations did, per pixel.

    Fields: ``kind`` (``UInt32``, index into :data:`mitsuba_restir.shifts.pivot.CLASSES`),
    ``accepted`` (``UInt32``, number of accepted steps), ``raised`` and ``lowered`` (``UInt32``,
    those of them that changed the target function), ``angle`` (``Float``, sum of the changes of
    direction of the accepted steps [rad]).
    """

    kind: Any
    accepted: Any
    raised: Any
    lowered: Any
    angle: Any


def metropolis_hastings(current: State, proposed: State, transition: Any) -> Any:
    """The Metropolis-Hastings rule C(y) T(y->x) / (C(x) T(x->y)), not yet clamped to 1."""
    before = target(current.color)
    return dr.select(before > 0, target(proposed.color) / before * transition, 0)


@dr.syntax
def decorrelate(
    scene: mi.Scene,
    sensor: mi.Sensor | None,
    reservoirs: Reservoir,
    hits: PrimaryHit,
    mutations: int,
    step: float,
    sample: Any,
    seed: Any,
    mapping: ShiftMapping,
    acceptance: Acceptance,
    pixel: Any = None,
) -> tuple[Reservoir, Mutated]:
    """Run ``mutations`` steps of the Markov chain on every pixel's path.

    Parameters
    ----------
    reservoirs, hits : Reservoir, PrimaryHit
        One lane per pixel.
    step : float
        Standard deviation of a step in primary sample space (the unit square).
    acceptance : callable
        See :data:`Acceptance`.
    pixel : UInt32, optional
        Row-major index of each lane's pixel, where the lanes are not all pixels in order.
    """
    if pixel is None:
        pixel = dr.arange(mi.UInt32, dr.width(hits.vertex.p))
    random = pass_stream(MUTATION, pixel, sample, seed)
    active = (reservoirs.weight > 0) & movable(reservoirs.path)
    pivot = pivot_of(scene, sensor, reservoirs.path, hits, mapping, active)
    active = pivot.valid
    next_si = next_interaction(reservoirs.path, pivot.lambdas, active)
    state = _current(scene, pivot, next_si, reservoirs, mapping, active)

    weight = mi.Float(reservoirs.weight)
    accepted = mi.UInt32(0)
    raised = mi.UInt32(0)
    lowered = mi.UInt32(0)
    angle = mi.Float(0)
    i = mi.UInt32(0)

    while dr.hint(active & (i < mutations), exclude=[mapping, acceptance], label="Mutations"):
        proposed, transition, shadow, tested = _propose(
            scene, pivot, next_si, state, random, i, step, mapping, active
        )
        u = uniform(random, i, 2)
        take = active & (u < acceptance(state, proposed, transition))
        take &= target(proposed.color) > 0
        # An occluded proposal is rejected. Only what would be accepted needs to be tested for that.
        take &= ~scene.ray_test(shadow, take & tested)
        weight = dr.select(take, weight * target(state.color) / target(proposed.color), weight)
        accepted += dr.select(take, mi.UInt32(1), 0)
        gain = target(proposed.color) - target(state.color)
        raised += dr.select(take & (gain > 0), mi.UInt32(1), 0)
        lowered += dr.select(take & (gain < 0), mi.UInt32(1), 0)
        angle += dr.select(take, dr.norm(proposed.direction - state.direction), 0)
        state = dr.select(take, proposed, state)
        i += 1

    moved = accepted > 0
    mutated = Reservoir(
        dr.select(moved, state.path, reservoirs.path),
        dr.select(moved, state.color, reservoirs.color),
        dr.select(moved, weight, reservoirs.weight),
        reservoirs.confidence,
    )
    kind = mutation_class(reservoirs.path)
    return mutated, Mutated(kind, accepted, raised, lowered, angle)


def _current(
    scene: mi.Scene,
    pivot: Pivot,
    next_si: mi.SurfaceInteraction3f,
    reservoirs: Reservoir,
    mapping: ShiftMapping,
    active: Any,
) -> State:
    """The chain's first state: the reservoir's own path, with its stored colour."""
    path = reservoirs.path
    ray, pi = seen_from(path.vertex, pivot.si.p, pivot.lambdas)
    si = pi.compute_surface_interaction(ray, active=active)
    # A path to the environment has no vertex; its direction is stored.
    direction = dr.select(kind_of(path) == kinds.ENVIRONMENT, path.wo, ray.d)
    si.wi = dr.select(si.is_valid(), si.wi, -direction)
    state, _, _ = at_vertex(
        scene, pivot, next_si, path, path.vertex, si, direction, mapping, active
    )
    return State(path, reservoirs.color, state.density, state.direction, state.pdf)


def _propose(
    scene: mi.Scene,
    pivot: Pivot,
    next_si: mi.SurfaceInteraction3f,
    state: State,
    random: Any,
    index: Any,
    step: float,
    mapping: ShiftMapping,
    active: Any,
) -> tuple[State, Any, mi.Ray3f, Any]:
    """Draw a proposal; return it, T(y->x)/T(x->y), and its shadow ray with the lanes that have one.

    Its colour is that without occlusion.
    """
    u = mi.Point2f(*uniform2(random, index, 0))
    by_numbers = kind_of(state.path) == kinds.REPLAY_NEE
    to_environment = kind_of(state.path) == kinds.ENVIRONMENT
    path = _move_numbers(state.path, by_numbers, u, step)

    concentration = _concentration(state.pdf, step)
    local = mi.warp.square_to_von_mises_fisher(u, concentration)
    ray = pivot.si.spawn_ray(mi.Frame3f(state.direction).to_world(local))
    aimed = active & ~by_numbers
    pi = scene.ray_intersect_preliminary(ray, coherent=False, active=aimed)
    si = pi.compute_surface_interaction(ray, active=aimed)
    direction = dr.select(si.is_valid(), dr.normalize(si.p - pivot.si.p), ray.d)
    lands = active & (by_numbers | (si.is_valid() ^ to_environment))

    proposed, shadow, tested = at_vertex(
        scene, pivot, next_si, path, compact(pi, si.p), si, direction, mapping, lands
    )

    lobe = _log_lobe(state, proposed.pdf, proposed, step) - _log_lobe(
        proposed, state.pdf, state, step
    )
    transition = proposed.density / state.density * dr.select(by_numbers, 1, dr.exp(lobe))
    return proposed, transition, shadow, tested


def _move_numbers(path: PathRecord, moves: Any, u: Any, step: float) -> PathRecord:
    """Perturb the numbers that sampled a light, on the torus."""
    moved = mi.Point2f(path.wo.x, path.wo.y) + step * mi.warp.square_to_std_normal(u)
    moved -= dr.floor(moved)
    # The floor of a tiny negative number rounds to 1, which is outside the square.
    moved = dr.minimum(moved, 1 - 2.0**-24)
    return replace(path, wo=dr.select(moves, mi.Vector3f(moved.x, moved.y, 0), path.wo))


def _concentration(pdf: Any, step: float) -> Any:
    """Concentration of the lobe whose variance is ``step``^2 / pdf."""
    return pdf / step**2


def _log_lobe(end: State, pdf: Any, start: State, step: float) -> Any:
    """Logarithm of the von Mises-Fisher density of ``end`` around ``start``, up to a constant."""
    concentration = _concentration(pdf, step)
    distance2 = dr.squared_norm(end.direction - start.direction)
    # c / (1 - exp(-2 c)), by its series where the difference would cancel.
    scale = dr.select(
        concentration > 0.05,
        concentration / (1 - dr.exp(-2 * concentration)),
        0.5 + 0.5 * concentration + dr.square(concentration) / 6,
    )
    return dr.log(scale) - 0.5 * concentration * distance2
