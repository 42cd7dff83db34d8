"""The transport identity: a sharper test of a shift than any image.

Let x be a resampled path of pixel i with weight W, y = T(x) its shift to pixel j, and m the balance
weight of "shifted from i" against "sampled in j". Then for every pair of pixels

    E[ m(y) F_j(y) |J| W_x ]  =  E[ m(y') F_j(y') W_y' ],

where y' is a resampled path of pixel j itself,
because both are the integral of m F_j over the paths that both pixels can make. Spatial reuse is
built on this identity, and averages its errors over random neighbours, which hides most of them:
what is lost to the right is gained from the left. Here every pixel looks at the neighbour at one
fixed offset, and nothing cancels.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from mitsuba_restir.paths.grid import grid_of
from mitsuba_restir.paths.primary_hit import PrimaryHit
from mitsuba_restir.paths.spectrum import target
from mitsuba_restir.paths.vertex import exists
from mitsuba_restir.resampling.reservoir import Reservoir
from mitsuba_restir.shifts import hybrid

from .bias import BiasReport
from .modes import Mode
from .pixels import image_of
from .references import Case
from .runs import bias_report, integrator
from .scopes import scope_maker


def candidates(
    max_depth: int, scene: mi.Scene, spp: int = 1, **parameters: Any
) -> Iterator[tuple[Any, Reservoir, PrimaryHit]]:
    """The renderer, fresh reservoirs and primary hits of one frame after the other, for ever."""
    mode = Mode({"temporal": False, "spatial": False, **parameters})
    renderer = integrator(max_depth, mode)
    seed = 0
    while True:
        renderer.render(scene, seed=seed, spp=spp)
        yield renderer, renderer._history.reservoirs, renderer._history.hits
        seed += 1


def neighbour(scene: mi.Scene, offset: tuple[int, int]) -> tuple[Any, Any]:
    """Index of the pixel at an offset (columns, rows) from each pixel, and whether it exists."""
    grid = grid_of(*scene.sensors()[0].film().crop_size())
    return grid.look(grid.pixels(), *offset)


def recorded_shift(renderer: Any) -> Any:
    """The shift as a function of (scene, path, hits, active), recorded once."""

    scope_of = scope_maker(renderer)

    @dr.freeze
    def shift(scene: mi.Scene, path: Any, hits: PrimaryHit, active: Any) -> hybrid.Shifted:
        return hybrid.shift(scope_of(scene), path, hits, active)

    return shift


def transport_errors(
    scene: mi.Scene, max_depth: int, offset: tuple[int, int], **parameters: Any
) -> Iterator[np.ndarray]:
    """Left minus right of the identity in every pixel, (H, W, 3), for one frame after the other."""
    width, height = scene.sensors()[0].film().crop_size()
    other, inside = neighbour(scene, offset)
    recorded = None
    for renderer, reservoirs, hits in candidates(max_depth, scene, **parameters):
        if recorded is None:
            recorded = dr.freeze(_errors(renderer))
        d = recorded(scene, scene.sensors()[0], reservoirs, hits, other, inside)
        yield np.moveaxis(image_of(d, width, height), 0, -1).astype(np.float64)


def _errors(renderer: Any) -> Any:
    scope_of = scope_maker(renderer)

    def errors(
        scene: mi.Scene,
        sensor: mi.Sensor,
        reservoirs: Reservoir,
        hits: PrimaryHit,
        other: Any,
        inside: Any,
    ) -> Any:
        scope = scope_of(scene, sensor)
        near = hits.at(other, inside)
        theirs = dr.gather(Reservoir, reservoirs, other, inside)
        valid = inside & exists(hits.vertex) & exists(near.vertex)
        forward = hybrid.shift(scope, theirs.path, hits, valid & (theirs.weight > 0))
        backward = hybrid.shift(scope, reservoirs.path, near, valid & (reservoirs.weight > 0))
        shifted = target(theirs.color) / forward.jacobian
        left_share = shifted / (shifted + target(forward.color))
        back = target(backward.color) * backward.jacobian
        right_share = back / (back + target(reservoirs.color))
        left = forward.color * (forward.jacobian * theirs.weight * left_share)
        right = reservoirs.color * (reservoirs.weight * right_share)
        left = dr.select(valid & (target(forward.color) > 0) & (theirs.weight > 0), left, 0)
        right = dr.select(valid & (back > 0) & (reservoirs.weight > 0), right, 0)
        return left - right

    return errors


def transport_report(
    case: Case, offset: tuple[int, int], runs: int, reference: np.ndarray, **parameters: Any
) -> BiasReport:
    """Test that the errors vanish; they are added to the reference, so that powers are relative."""
    errors = transport_errors(case.load(), case.max_depth, offset, **parameters)
    return bias_report((reference + error for error in errors), runs, reference)
