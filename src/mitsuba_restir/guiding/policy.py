"""How path trees grow, by what earlier frames have taught."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit
from ..paths.spectrum import target
from ..resampling.reservoir import Reservoir
from .guide import Guide, no_guide
from .learn import learn
from .roulette import (
    ByContribution,
    ByThroughput,
    Expected,
    Roulette,
    nothing_expected,
    nothing_noted,
    updated,
)
from .steering import ByBsdf, ByGuide, Steering


@dataclass
class Learnt:
    """What earlier frames have taught.

    Fields: ``guide`` (None without guiding), ``expected`` (None where roulette goes by throughput).
    """

    guide: Guide | None
    expected: Expected | None


@dataclass(frozen=True)
class Policy:
    """Where the directions of bounces come from, and which paths go on."""

    steering: Steering
    roulette: Roulette


def nothing_learnt(scene: mi.Scene, guiding: bool, by_contribution: bool) -> Learnt:
    """Before the first frame."""
    return Learnt(
        no_guide(scene) if guiding else None,
        nothing_expected(scene) if by_contribution else None,
    )


def policy_of(learnt: Learnt, rr_depth: int, suffixes: bool) -> Policy:
    """The policy of the next frame.

    Parameters
    ----------
    rr_depth : int
        Where roulette by throughput begins.
    suffixes : bool
        Whether bounces after the one that leaves the reconnection vertex may be guided, too.
    """
    steering: Steering = ByBsdf() if learnt.guide is None else ByGuide(learnt.guide, suffixes)
    if learnt.expected is None:
        return Policy(steering, ByThroughput(rr_depth))
    return Policy(steering, ByContribution(learnt.expected, nothing_noted()))


def after_frame(
    learnt: Learnt, policy: Policy, candidates: Reservoir, hit: PrimaryHit, memory: float
) -> Learnt:
    """With what a frame's candidates have taught; evaluated.

    Parameters
    ----------
    candidates, hit : Reservoir, PrimaryHit
        One lane per pixel; evaluated.
    memory : float
        What the past counts with from frame to frame; 1 where nothing moves.
    """
    guide, expected, roulette = learnt.guide, learnt.expected, policy.roulette
    if guide is not None:
        guide = learn(guide, candidates, hit, memory)
    if isinstance(roulette, ByContribution):
        luminance = target(candidates.color) * candidates.weight
        expected = updated(roulette.expected, roulette.notes, luminance, memory)
    learnt = Learnt(guide, expected)
    dr.eval(learnt)
    return learnt
