"""Proposals that move the reconnection vertex.

The direction that leaves x_{k-1} is perturbed by a von Mises-Fisher lobe around it, with a
concentration proportional to the BSDF pdf: in primary sample space that is a step of constant size,
without inverting the BSDF's sampling routine. The lobe's ratio is part of the acceptance. Of a path
that ends in a light sampled before any reconnection vertex, the light's numbers are moved instead.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit
from ..paths.record import Kind, PathRecord, kind_of
from ..paths.vertex import Spot, connected, stored
from ..resampling.reservoir import Reservoir
from ..sampling.streams import Stream, uniform2
from ..shifts.scope import Scope
from .kind import Proposal, State
from .perturb import CHANGES, Landing, at_vertex
from .pivot import Pivot, movable, pivot_of


@dataclass(frozen=True)
class MoveReconnectionVertex:
    """The mutation of Sawhney et al. 2024.

    Attributes
    ----------
    step : float
        Standard deviation of a step in primary sample space (the unit square).
    """

    step: float
    changes = CHANGES

    def begin(self, scope: Scope, reservoirs: Reservoir, hits: PrimaryHit) -> tuple[Pivot, State]:
        """See :class:`.kind.Mutation`; the first state is the path itself, with its colour."""
        path = reservoirs.path
        pivot = pivot_of(scope, path, hits, (reservoirs.weight > 0) & movable(path))
        seen, _ = connected(pivot.si, path.vertex, pivot.valid)
        ray, si = seen.ray, seen.si
        # A path to the environment has no vertex; its direction is stored.
        ray.d = dr.select(kind_of(path) == Kind.ENVIRONMENT, path.wo, ray.d)
        si.wi = dr.select(si.is_valid(), si.wi, -ray.d)
        landing = Landing(path.vertex, si, ray)
        state, _, _ = at_vertex(scope, pivot, path, landing, pivot.valid)
        return pivot, replace(state, path=path, color=reservoirs.color)

    def propose(
        self,
        scope: Scope,
        pivot: Pivot,
        state: State,
        random: Stream,
        i: mi.UInt32,
        active: mi.Bool,
    ) -> Proposal:
        """See :class:`.kind.Mutation`."""
        path, direction = aim(state, random, i, self.step)
        proposed, shadow, tested = landed(scope, pivot, path, direction, active)
        way_back = aimed_back(state, proposed, self.step)
        transition = proposed.density / state.density * way_back
        return Proposal(proposed, transition, shadow, tested)


def aim(state: State, random: Stream, i: mi.UInt32, step: float) -> tuple[PathRecord, mi.Vector3f]:
    """Perturb a state's direction; or, where there is none, the numbers that sample its light."""
    u = mi.Point2f(*uniform2(random, i, 0))
    by_numbers = kind_of(state.path) == Kind.REPLAY_NEE
    path = _move_numbers(state.path, by_numbers, u, step)
    return path, perturbed(state.direction, state.pdf, u, step)


def aimed_back(start: State, end: State, step: float) -> mi.Float:
    """Density of :func:`aim` from ``end`` to ``start`` over that of the way there."""
    by_numbers = kind_of(start.path) == Kind.REPLAY_NEE
    lobe = lobe_ratio(start.direction, start.pdf, end.direction, end.pdf, step)
    return dr.select(by_numbers, 1, lobe)


def landed(
    scope: Scope, pivot: Pivot, path: PathRecord, direction: mi.Vector3f, active: mi.Bool
) -> tuple[State, mi.Ray3f, mi.Bool]:
    """The path that leaves x_{k-1} in another direction; returns as of :func:`.perturb.at_vertex`.

    A path whose light is sampled from there carries its new numbers already, and has no direction.
    """
    by_numbers = kind_of(path) == Kind.REPLAY_NEE
    to_environment = kind_of(path) == Kind.ENVIRONMENT
    ray = pivot.si.spawn_ray(direction)
    aimed = active & ~by_numbers
    pi = scope.scene.ray_intersect_preliminary(ray, coherent=False, active=aimed)
    si = pi.compute_surface_interaction(ray, active=aimed)
    lands = active & (by_numbers | (si.is_valid() ^ to_environment))
    vertex = stored(pi, si.p, isinstance(path.vertex, Spot))
    return at_vertex(scope, pivot, path, Landing(vertex, si, ray), lands)


def perturbed(direction: mi.Vector3f, pdf: mi.Float, u: mi.Point2f, step: float) -> mi.Vector3f:
    """A direction of the lobe around another one, whose BSDF pdf is ``pdf``."""
    local = mi.warp.square_to_von_mises_fisher(u, _concentration(pdf, step))
    return mi.Frame3f(direction).to_world(local)


def lobe_ratio(
    start: mi.Vector3f, start_pdf: mi.Float, end: mi.Vector3f, end_pdf: mi.Float, step: float
) -> mi.Float:
    """Density of perturbing ``end`` to ``start`` over that of the way there."""
    distance2 = dr.squared_norm(end - start)
    return dr.exp(
        _log_lobe(distance2, _concentration(end_pdf, step))
        - _log_lobe(distance2, _concentration(start_pdf, step))
    )


def _move_numbers(path: PathRecord, moves: mi.Bool, u: mi.Point2f, step: float) -> PathRecord:
    """Perturb the numbers that sampled a light, on the torus."""
    moved = path.leaving + step * mi.warp.square_to_std_normal(u)
    moved -= dr.floor(moved)
    # The floor of a tiny negative number rounds to 1, which is outside the square.
    moved = dr.minimum(moved, 1 - 2.0**-24)
    return replace(path, leaving=dr.select(moves, moved, path.leaving))


def _concentration(pdf: mi.Float, step: float) -> mi.Float:
    """Concentration of the lobe whose variance is ``step``^2 / pdf."""
    return pdf / step**2


def _log_lobe(distance2: mi.Float, concentration: mi.Float) -> mi.Float:
    """Logarithm of the von Mises-Fisher density at a squared chord, up to a constant."""
    # c / (1 - exp(-2 c)), by its series where the difference would cancel.
    scale = dr.select(
        concentration > 0.05,
        concentration / (1 - dr.exp(-2 * concentration)),
        0.5 + 0.5 * concentration + dr.square(concentration) / 6,
    )
    return dr.log(scale) - 0.5 * concentration * distance2
