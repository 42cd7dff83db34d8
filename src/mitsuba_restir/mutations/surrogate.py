r"""Proposals that are chains themselves, on a target function that needs no ray.

A step of the reconnection vertex costs a ray to find where it lands and one for what it is lit by.
A surrogate transition (Liu 2001, section 9.4.3) spends them on the last of many steps: n steps of a
chain that leaves another function C* stationary lead from x to y, and y is accepted with

    min(1, C(y) C*(x) / (C(x) C*(y))),

because a chain that leaves C* stationary and is reversible proposes the way back C*(x) / C*(y)
times as often. C* must be the same function from both ends. Here it looks at x_{k-1} and at the
plane of x_k's face, which goes on without end and hides nothing: so the proposal must land in the
same plane of the same shape, and is refused otherwise. Some steps are therefore plain ones, by a
coin that knows nothing of the path, and the only ones of paths that have no such plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..paths.packing import number_of
from ..paths.primary_hit import PrimaryHit
from ..paths.record import Kind, continuation_of, kind_of, reconnection_index
from ..paths.scattering import evaluate, light_numbers, sample_light
from ..paths.vertex import exists
from ..resampling.reservoir import Reservoir
from ..sampling.streams import Stream, uniform, uniform2
from ..shifts.scope import Scope
from .kind import Proposal, State
from .perturb import CHANGES
from .pivot import Pivot
from .proposals import MoveReconnectionVertex, aim, aimed_back, landed, lobe_ratio, perturbed

PLAIN = 0.25
"""Share of the steps that are plain ones, which alone leave the plane."""

SAME_NORMAL = 1e-10
"""Largest squared difference of the unit normals of what counts as one plane."""

SAME_OFFSET = 1e-4
"""Largest distance from the plane, relative to that of x_{k-1} from x_k."""


@dataclass
class Surrogate:
    """C* of a path: what leaves x_{k-1}, and what the plane of x_k's face makes of it.

    Fields: ``p`` and ``normal`` of the plane; ``follows`` (x_{k+1} exists), ``next_p`` and
    ``next_normal``; ``lit`` (a light is sampled from x_k instead, with ``numbers``).
    """

    p: mi.Point3f
    normal: mi.Normal3f
    follows: mi.Bool
    next_p: mi.Point3f
    next_normal: mi.Normal3f
    lit: mi.Bool
    numbers: mi.Point2f

    def density(
        self, scope: Scope, pivot: Pivot, direction: mi.Vector3f, active: mi.Bool
    ) -> tuple[mi.Float, mi.Float]:
        """C* by solid angle at x_{k-1}, up to a constant, and the BSDF pdf [1/sr] there.

        x_k is taken for diffuse, x_{k+1} too, and MIS weights for constant.
        """
        value, pdf = evaluate(pivot.si, pivot.si.bsdf(), direction, active)
        distance = dr.dot(self.normal, self.p - pivot.si.p) / dr.dot(self.normal, direction)
        si = mi.SurfaceInteraction3f(pivot.si)
        si.p = pivot.si.p + distance * direction
        onward = self.next_p - si.p
        cosines = dr.abs(dr.dot(self.normal, onward) * dr.dot(self.next_normal, onward))
        geometry = dr.select(self.follows, cosines / dr.square(dr.squared_norm(onward)), 1)
        light = sample_light(scope.scene, si, self.numbers, False, active & self.lit)
        sampled = dr.mean(light.weight) * dr.abs(dr.dot(self.normal, light.d))
        found = dr.mean(value) * dr.select(self.lit, sampled, geometry)
        valid = active & (distance > 0) & (pdf > 0) & (found > 0) & (found < dr.inf)
        return dr.select(valid, found, 0), pdf


def surrogate_of(pivot: Pivot, state: State) -> Surrogate:
    """The surrogate of a state, in the plane of its own x_k."""
    path, following = state.path, continuation_of(state.path)
    kind = kind_of(path)
    ahead = ((kind == Kind.FAR) | (kind == Kind.HIT)) & exists(following.vertex)
    return Surrogate(
        state.p,
        state.normal,
        ahead,
        pivot.next_si.p,
        pivot.next_si.n,
        kind == Kind.NEE,
        light_numbers(pivot.stream, reconnection_index(path)),
    )


def same_plane(pivot: Pivot, start: State, end: State) -> mi.Bool:
    """Whether both states have the same surrogate: x_k in one plane of one shape."""
    here, there = start.path.vertex, end.path.vertex
    span = end.p - start.p
    aside = dr.abs(dr.dot(start.normal, span))
    return (
        (number_of(here.shape) == number_of(there.shape))
        & (number_of(here.instance) == number_of(there.instance))
        & (dr.squared_norm(end.normal - start.normal) < SAME_NORMAL)
        & (aside < SAME_OFFSET * dr.norm(start.p - pivot.si.p))
    )


@dataclass(frozen=True)
class MoveInPlane:
    """The mutation of Sawhney et al. 2024, with a chain on a surrogate before each true step.

    Attributes
    ----------
    plain : MoveReconnectionVertex
        The mutation that it refines; it says how long a step is.
    steps : int
        Of the surrogate's chain.
    """

    plain: MoveReconnectionVertex
    steps: int
    changes = CHANGES

    def begin(self, scope: Scope, reservoirs: Reservoir, hits: PrimaryHit) -> tuple[Pivot, State]:
        """See :class:`.kind.Mutation`."""
        return self.plain.begin(scope, reservoirs, hits)

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
        kind, size = kind_of(state.path), self.plain.step
        planar = (kind != Kind.REPLAY_NEE) & (kind != Kind.ENVIRONMENT)
        walks = active & planar & (uniform(random, i, 3) >= PLAIN)
        path, aimed = aim(state, random, i, size)
        walked, way_back = walk(scope, pivot, state, random.fork(i), self, walks)
        direction = dr.select(walks, walked, aimed)
        going = active & (~walks | (way_back > 0))
        proposed, shadow, tested = landed(scope, pivot, path, direction, going)
        way_back = dr.select(same_plane(pivot, state, proposed), way_back, 0)
        way_back = dr.select(walks, way_back, aimed_back(state, proposed, size))
        transition = proposed.density / state.density * way_back
        return Proposal(proposed, transition, shadow, tested)


@dr.syntax
def walk(
    scope: Scope,
    pivot: Pivot,
    state: State,
    random: Stream,
    mutation: MoveInPlane,
    active: mi.Bool,
) -> tuple[mi.Vector3f, mi.Float]:
    """A chain of the surrogate from a state's direction: where it ends, and C*(start) / C*(end).

    The ratio is 0 where the chain has not moved.
    """
    surrogate, size = surrogate_of(pivot, state), mutation.plain.step
    direction, pdf = mi.Vector3f(state.direction), mi.Float(state.pdf)
    first, _ = surrogate.density(scope, pivot, direction, active)
    density = mi.Float(first)
    active &= first > 0
    moved = mi.Bool(False)
    j = mi.UInt32(0)
    while dr.hint(
        active & (j < mutation.steps),
        exclude=[scope, pivot, surrogate, mutation, random, state],
        label="Surrogate",
    ):
        u = mi.Point2f(*uniform2(random, j, 0))
        proposed = perturbed(direction, pdf, u, size)
        new_density, new_pdf = surrogate.density(scope, pivot, proposed, active)
        ratio = new_density / density * lobe_ratio(direction, pdf, proposed, new_pdf, size)
        take = (new_density > 0) & (uniform(random, j, 1) < ratio)
        direction = dr.select(take, proposed, direction)
        pdf = dr.select(take, new_pdf, pdf)
        density = dr.select(take, new_density, density)
        moved |= take
        j += 1
    return direction, dr.select(moved, first / density, 0)
