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
from ..paths.vertex import compact, connected
from ..resampling.reservoir import Reservoir
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
        ray, pi, _ = connected(pivot.si, path.vertex)
        si = pi.compute_surface_interaction(ray, active=pivot.valid)
        # A path to the environment has no vertex; its direction is stored.
        ray.d = dr.select(kind_of(path) == Kind.ENVIRONMENT, path.wo, ray.d)
        si.wi = dr.select(si.is_valid(), si.wi, -ray.d)
        landing = Landing(path.vertex, si, ray)
        state, _, _ = at_vertex(scope, pivot, path, landing, pivot.valid)
        return pivot, replace(state, path=path, color=reservoirs.color)

    def propose(
        self, scope: Scope, pivot: Pivot, state: State, u: mi.Point2f, active: mi.Bool
    ) -> Proposal:
        """See :class:`.kind.Mutation`."""
        by_numbers = kind_of(state.path) == Kind.REPLAY_NEE
        to_environment = kind_of(state.path) == Kind.ENVIRONMENT
        path = _move_numbers(state.path, by_numbers, u, self.step)

        concentration = _concentration(state.pdf, self.step)
        local = mi.warp.square_to_von_mises_fisher(u, concentration)
        ray = pivot.si.spawn_ray(mi.Frame3f(state.direction).to_world(local))
        aimed = active & ~by_numbers
        pi = scope.scene.ray_intersect_preliminary(ray, coherent=False, active=aimed)
        si = pi.compute_surface_interaction(ray, active=aimed)
        lands = active & (by_numbers | (si.is_valid() ^ to_environment))

        landing = Landing(compact(pi, si.p), si, ray)
        proposed, shadow, tested = at_vertex(scope, pivot, path, landing, lands)

        lobe = _log_lobe(state, proposed.pdf, proposed, self.step) - _log_lobe(
            proposed, state.pdf, state, self.step
        )
        transition = proposed.density / state.density * dr.select(by_numbers, 1, dr.exp(lobe))
        return Proposal(proposed, transition, shadow, tested)


def _move_numbers(path: PathRecord, moves: mi.Bool, u: mi.Point2f, step: float) -> PathRecord:
    """Perturb the numbers that sampled a light, on the torus."""
    moved = mi.Point2f(path.wo.x, path.wo.y) + step * mi.warp.square_to_std_normal(u)
    moved -= dr.floor(moved)
    # The floor of a tiny negative number rounds to 1, which is outside the square.
    moved = dr.minimum(moved, 1 - 2.0**-24)
    return replace(path, wo=dr.select(moves, mi.Vector3f(moved.x, moved.y, 0), path.wo))


def _concentration(pdf: mi.Float, step: float) -> mi.Float:
    """Concentration of the lobe whose variance is ``step``^2 / pdf."""
    return pdf / step**2


def _log_lobe(end: State, pdf: mi.Float, start: State, step: float) -> mi.Float:
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
