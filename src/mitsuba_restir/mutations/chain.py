"""The Markov chain of every pixel: steps of one kind of mutation, taken by an acceptance rule.

The stationary density is the target function C, so that a mutated path stays a sample of it and
W' = W C(x) / C(y) keeps its contribution unbiased (Sawhney et al. 2024).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit
from ..paths.spectrum import target
from ..resampling.reservoir import Reservoir
from ..sampling.streams import Purpose, uniform
from ..shifts.scope import Scope
from .kind import MutationPlan, Proposal, State
from .pivot import mutation_class

Acceptance: TypeAlias = "Callable[[State, Proposal], mi.Float]"
"""Acceptance rule: the probability of taking the proposal, not yet clamped to 1."""


@dataclass
class Mutated:
    """What the mutations did, per pixel.

    Fields: ``kind`` (a member of :class:`.pivot.MutationClass`), ``accepted`` (number of accepted
    steps), ``raised`` and ``lowered`` (those of them that changed the target function), ``angle``
    (sum of the changes of direction of the accepted steps [rad]).
    """

    kind: mi.UInt8
    accepted: mi.UInt32
    raised: mi.UInt32
    lowered: mi.UInt32
    angle: mi.Float


def metropolis_hastings(current: State, proposal: Proposal) -> mi.Float:
    """The rule of :cite:t:`Hastings1970`, C(y) T(y->x) / (C(x) T(x->y))."""
    before = target(current.color)
    after = target(proposal.state.color)
    return dr.select(before > 0, after / before * proposal.transition, 0)


@dr.syntax
def run_chain(
    scope: Scope,
    reservoirs: Reservoir,
    hits: PrimaryHit,
    pixel: mi.UInt32,
    plan: MutationPlan,
    acceptance: Acceptance,
) -> tuple[Reservoir, Mutated]:
    """Run the steps of the chain on every lane's path.

    Parameters
    ----------
    reservoirs, hits : Reservoir, PrimaryHit
        One lane per pixel that has its turn.
    pixel : UInt32
        Index of each lane's pixel.
    """
    mutation, steps = plan.kind, plan.steps
    random = scope.key.stream(Purpose.MUTATION, pixel)
    pivot, state = mutation.begin(scope, reservoirs, hits)
    active = pivot.valid

    weight = mi.Float(reservoirs.weight)
    accepted = mi.UInt32(0)
    raised = mi.UInt32(0)
    lowered = mi.UInt32(0)
    angle = mi.Float(0)
    i = mi.UInt32(0)

    while dr.hint(active & (i < steps), exclude=[scope, mutation, acceptance], label="Mutations"):
        proposal = mutation.propose(scope, pivot, state, random, i, active)
        proposed = proposal.state
        take = active & (uniform(random, i, 2) < acceptance(state, proposal))
        new_weight = weight * target(state.color) / target(proposed.color)
        # A path without light, or with more than a weight can follow, is outside of the chain.
        take &= (new_weight > 0) & (new_weight < dr.inf)
        # An occluded proposal is rejected. Only what would be accepted needs to be tested for that.
        take &= ~scope.scene.ray_test(proposal.shadow, take & proposal.tested)
        weight = dr.select(take, new_weight, weight)
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
    return mutated, Mutated(mi.UInt8(kind), accepted, raised, lowered, angle)
