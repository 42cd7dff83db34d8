"""The stationarity identity: the sharpest test of a mutation.

Let x be a resampled path with weight W, and y, W' what a mutation makes of them. Then for every
function g of a path

    E[ g(y) W' ]  =  E[ g(x) W ],

and the difference can be taken path by path, so that most of the noise cancels. Here g is what a
neighbour at a fixed offset would get from the path, with the balance weight of the two pixels.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from mitsuba_restir.mutations.kind import MutationPlan
from mitsuba_restir.paths.primary_hit import PrimaryHit
from mitsuba_restir.paths.spectrum import target
from mitsuba_restir.paths.vertex import exists
from mitsuba_restir.resampling.reservoir import Reservoir
from mitsuba_restir.shifts import hybrid
from mitsuba_restir.shifts.scope import Scope

from .bias import BiasReport
from .modes import Mode
from .pixels import image_of
from .references import Case
from .runs import bias_report, integrator
from .scopes import mutate, scope_maker
from .transport import neighbour

FRESH = Mode({"temporal": False, "spatial": False})


def differences(
    scene: mi.Scene,
    max_depth: int,
    mode: Mode,
    offset: tuple[int, int],
    plan: MutationPlan,
) -> Iterator[np.ndarray]:
    """g(y) W' - g(x) W in every pixel, (H, W, 3), for one independent run after the other."""
    width, height = scene.sensors()[0].film().crop_size()
    other, inside = neighbour(scene, offset)
    renderer = integrator(max_depth, mode, mutations=1)
    recorded = None
    seed = 0
    while True:
        renderer.reset()
        for _ in range(mode.frames):
            renderer.render(scene, seed=seed, spp=mode.spp)
        seed += 1
        if recorded is None:
            recorded = dr.freeze(_difference(renderer, plan))
        history = renderer._history
        number = dr.opaque(mi.UInt32, 1000 + seed)
        d = recorded(scene, history.reservoirs, history.hits, other, inside, number)
        yield np.moveaxis(image_of(d, width, height), 0, -1).astype(np.float64)


def _difference(renderer: Any, plan: MutationPlan) -> Any:
    scope_of = scope_maker(renderer)

    def difference(
        scene: mi.Scene,
        reservoirs: Reservoir,
        hits: PrimaryHit,
        other: Any,
        inside: Any,
        number: Any,
    ) -> Any:
        scope = scope_of(scene, number=number, seed=number)
        mutated, _ = mutate(scope, reservoirs, hits, plan)
        dr.eval(mutated)
        near = hits.at(other, inside)
        valid = inside & exists(near.vertex)
        return _seen(scope, mutated, near, valid) - _seen(scope, reservoirs, near, valid)

    return difference


def _seen(scope: Scope, reservoirs: Reservoir, near: PrimaryHit, valid: Any) -> Any:
    """What the neighbour gets: m F |J| W."""
    valid = valid & (reservoirs.weight > 0)
    shifted = hybrid.shift(scope, reservoirs.path, near, valid)
    here = target(reservoirs.color) / shifted.jacobian
    there = target(shifted.color)
    share = dr.select(there > 0, here / (here + there), 0)
    seen = shifted.color * (share * shifted.jacobian * reservoirs.weight)
    return dr.select(valid & (there > 0), seen, 0)


def stationarity_report(
    case: Case,
    offset: tuple[int, int],
    runs: int,
    reference: np.ndarray,
    plan: MutationPlan,
    mode: Mode = FRESH,
) -> BiasReport:
    """Test that the differences vanish; added to the reference, so that powers are relative."""
    found = differences(case.load(), case.max_depth, mode, offset, plan)
    return bias_report((reference + each for each in found), runs, reference)
