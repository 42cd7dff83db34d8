"""What a kind of mutation answers: where the chain begins, what it proposes, what it changes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import mitsuba as mi

from ..paths.primary_hit import PrimaryHit
from ..paths.record import PathRecord
from ..resampling.reservoir import Reservoir
from ..sampling.streams import Stream
from ..shifts.scope import Scope
from .pivot import Pivot


@dataclass
class State:
    """A state of the Markov chain.

    Fields: ``path``, ``color`` (F), ``density`` (the factors of the path's density that moves
    change, p(x_{k-1} -> x_k) among them), ``direction`` (x_{k-1} to x_k), ``pdf`` (its BSDF pdf),
    ``p`` and ``normal`` (of x_k and its face; 0 where there is none).
    """

    path: PathRecord
    color: mi.Color3f
    density: mi.Float
    direction: mi.Vector3f
    pdf: mi.Float
    p: mi.Point3f
    normal: mi.Normal3f


@dataclass
class Proposal:
    """A proposed state y.

    Fields: ``state`` (its colour is that without occlusion), ``transition`` (T(y->x) / T(x->y)),
    ``shadow`` (the segment that must be unoccluded) and ``tested`` (lanes that have one).
    """

    state: State
    transition: mi.Float
    shadow: mi.Ray3f
    tested: mi.Bool


class Mutation(Protocol):
    """A kind of mutation."""

    changes: tuple[str, ...]
    """Fields of :class:`PathRecord` that a step may change; all others are left as they are."""

    def begin(self, scope: Scope, reservoirs: Reservoir, hits: PrimaryHit) -> tuple[Pivot, State]:
        """What the chain leaves alone (invalid where there is no chain), and its first state."""

    def propose(
        self,
        scope: Scope,
        pivot: Pivot,
        state: State,
        random: Stream,
        i: mi.UInt32,
        active: mi.Bool,
    ) -> Proposal:
        """Draw a proposal with the numbers of the stream's ``i``-th vertex in block 0, and fork."""


@dataclass(frozen=True)
class MutationPlan:
    """How the paths of a frame are mutated.

    Attributes
    ----------
    kind : Mutation
    steps : int
        Of the chain, for every pixel that has its turn.
    interval : int
        Every pixel has its turn once in so many frames.
    acceptance : str
        Name of the rule, see :data:`mitsuba_restir.passes.decorrelate.RULES`.
    energy_weight : float
        Weight of the energy in the rules that have one, from 0 to 1.
    """

    kind: Mutation
    steps: int
    interval: int
    acceptance: str
    energy_weight: float
