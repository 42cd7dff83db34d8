"""What tests that call a pass by itself give it: a frame's scope, and a plan of mutations."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi

from mitsuba_restir.mutations.chain import Acceptance, Mutated, metropolis_hastings, run_chain
from mitsuba_restir.mutations.kind import MutationPlan
from mitsuba_restir.mutations.proposals import MoveReconnectionVertex
from mitsuba_restir.mutations.surrogate import MoveInPlane
from mitsuba_restir.paths.grid import grid_of
from mitsuba_restir.paths.primary_hit import PrimaryHit
from mitsuba_restir.paths.spectrum import spectra_of
from mitsuba_restir.paths.vertex import Stored, sight
from mitsuba_restir.resampling.reservoir import Reservoir
from mitsuba_restir.sampling.streams import FrameKey
from mitsuba_restir.shifts.scope import Scope


def scope_maker(renderer: Any) -> Callable[..., Scope]:
    """Makes the scopes of frames as ``renderer``, which has rendered a scene, would make them.

    For recorded functions: Dr.Jit goes through all that such a function refers to and keeps it, and
    this refers to the plan of the frames, not to the renderer with its history and scene.
    """
    plan, dither, sensitivity = renderer._plan, renderer._dither, renderer._sensitivity

    def make(
        scene: mi.Scene, sensor: mi.Sensor | None = None, number: Any = 0, seed: Any = 0
    ) -> Scope:
        return Scope(
            scene,
            None if sensor is None else spectra_of(sensor, sensitivity),
            plan.mapping,
            plan.limits,
            grid_of(plan.width, plan.height),
            FrameKey(mi.UInt32(number), mi.UInt32(seed)),
            dither,
        )

    return make


def scope_of(
    renderer: Any,
    scene: mi.Scene,
    sensor: mi.Sensor | None = None,
    number: Any = 0,
    seed: Any = 0,
) -> Scope:
    """The scope of a frame.

    ``sensor`` samples wavelengths, where there are any; ``number`` and ``seed`` name the frame.
    """
    return scope_maker(renderer)(scene, sensor, number, seed)


def point_of(vertex: Stored) -> mi.Point3f:
    """Where a record's vertex is, in the scene as it is."""
    return sight(vertex, lambda p: p + mi.Vector3f(1, 2, 3), dr.zeros(mi.Ray3f).wavelengths, True).p


def mutation_plan(
    steps: int, step: float, interval: int = 1, energy_weight: float = 0, surrogates: int = 0
) -> MutationPlan:
    """Moves of the reconnection vertex by the unbiased rule, unless a test brings its own."""
    plain = MoveReconnectionVertex(step)
    kind = MoveInPlane(plain, surrogates) if surrogates else plain
    return MutationPlan(kind, steps, interval, "metropolis", energy_weight)


def mutate(
    scope: Scope,
    reservoirs: Reservoir,
    hits: PrimaryHit,
    plan: MutationPlan,
    acceptance: Acceptance | None = None,
) -> tuple[Reservoir, Mutated]:
    """Run the chain of every lane, however many there are, by the unbiased rule unless told."""
    pixel = dr.arange(mi.UInt32, dr.width(reservoirs.weight))
    return run_chain(scope, reservoirs, hits, pixel, plan, acceptance or metropolis_hastings)
