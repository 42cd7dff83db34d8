"""How path trees grow, by what earlier frames have taught."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit
from ..paths.spectrum import target
from ..resampling.reservoir import Reservoir
from .cells import Cells, cells_of
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

FIRST, EVERY = 32, 4
"""The first frames all teach, and then one in so many: the later ones have little to add."""

FADING = 0.9
"""What the past counts with from lesson to lesson where the scene changes."""


@dataclass
class Learnt:
    """What earlier frames have taught.

    Fields: ``cells`` (that it is kept by), ``guide`` (None without guiding), ``expected`` (None
    where roulette goes by throughput).
    """

    cells: Cells
    guide: Guide | None
    expected: Expected | None


@dataclass
class Findings:
    """What a frame can teach: its fresh ``candidates`` and the ``notes`` of roulette, if any."""

    candidates: Reservoir
    notes: mi.UInt64 | None


@dataclass(frozen=True)
class Policy:
    """Where the directions of bounces come from, and which paths go on."""

    steering: Steering
    roulette: Roulette


def nothing_learnt(scene: mi.Scene, guiding: bool, by_contribution: bool) -> Learnt | None:
    """Before the first frame; None where nothing is to be learnt."""
    if not guiding and not by_contribution:
        return None
    cells = cells_of(scene)
    dr.make_opaque(cells)
    guide = no_guide() if guiding else None
    return Learnt(cells, guide, nothing_expected() if by_contribution else None)


def policy_of(learnt: Learnt | None, rr_depth: int, suffixes: bool) -> Policy:
    """The policy of the next frame.

    Parameters
    ----------
    rr_depth : int
        Where roulette by throughput begins.
    suffixes : bool
        Whether bounces after the one that leaves the reconnection vertex may be guided, too.
    """
    steering: Steering = ByBsdf()
    roulette: Roulette = ByThroughput(rr_depth)
    if learnt is not None and learnt.guide is not None:
        steering = ByGuide(learnt.cells, learnt.guide, suffixes)
    if learnt is not None and learnt.expected is not None:
        roulette = ByContribution(learnt.cells, learnt.expected, nothing_noted())
    return Policy(steering, roulette)


def findings_of(policy: Policy, candidates: Reservoir) -> Findings:
    """What a frame with this policy has found."""
    roulette = policy.roulette
    notes = roulette.notes if isinstance(roulette, ByContribution) else None
    return Findings(candidates, notes)


def teaches(frame: int, changing: bool) -> bool:
    """Whether a frame, by its number from 0, teaches; all do where the scene is ``changing``."""
    return changing or frame < FIRST or frame % EVERY == 0


def taught(learnt: Learnt, findings: Findings, hit: PrimaryHit, changing: bool) -> Learnt:
    """With what a frame has found; evaluated.

    Parameters
    ----------
    findings, hit : Findings, PrimaryHit
        One lane per pixel; evaluated.
    changing : bool
        Whether the scene changes, so that the past fades.
    """
    memory = FADING if changing else 1.0
    guide, expected, candidates = learnt.guide, learnt.expected, findings.candidates
    if guide is not None:
        guide = learn(learnt.cells, guide, candidates, hit, memory)
    if expected is not None and findings.notes is not None:
        luminance = target(candidates.color) * candidates.weight
        expected = updated(expected, findings.notes, luminance, memory)
    learnt = Learnt(learnt.cells, guide, expected)
    dr.eval(learnt)
    return learnt
