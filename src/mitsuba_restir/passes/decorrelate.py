"""Decorrelation: Markov-chain mutations of every pixel's path, between the two reuse passes.

Sawhney et al. 2024. A mutation moves the reconnection vertex and corrects the contribution weight,
so that the luminance of F W is the same before and after: only neighbours, later frames and the
colour see a mutation.
"""

from __future__ import annotations

import mitsuba as mi

from ..mutations.chain import Mutated
from ..mutations.energy import mutate_by_energy, mutate_by_updated_energy
from ..mutations.kind import MutationPlan
from ..mutations.schedule import mutate_in_turns
from ..paths.primary_hit import PrimaryHit
from ..resampling.reservoir import Reservoir
from ..shifts.scope import Scope

RULES = {
    "metropolis": mutate_in_turns,
    "energy": mutate_by_energy,
    "energy_updated": mutate_by_updated_energy,
}
"""The values of ``mutation_acceptance``; the energies are biased."""


def decorrelate(
    scope: Scope,
    reservoirs: Reservoir,
    hits: PrimaryHit,
    plan: MutationPlan,
    turn: mi.UInt32,
) -> tuple[Reservoir, Mutated]:
    """Mutate the paths of a frame.

    Parameters
    ----------
    reservoirs, hits : Reservoir, PrimaryHit
        One lane per pixel; evaluated.
    turn : UInt32
        Number of the frame; decides which pixels are mutated where not all are.
    """
    return RULES[plan.acceptance](scope, reservoirs, hits, plan, turn)
