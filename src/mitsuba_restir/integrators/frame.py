"""One frame: the sequence of passes, as a function of plain data."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi

from ..guiding.policy import Findings, Learnt, findings_of, nothing_learnt, policy_of, taught
from ..mutations.chain import Mutated
from ..mutations.kind import MutationPlan
from ..mutations.proposals import MoveReconnectionVertex
from ..neighbors.color_history import ColorHistory, no_color_history
from ..neighbors.reproject import Motion, reproject
from ..neighbors.strategies import STRATEGIES
from ..passes.decorrelate import decorrelate
from ..passes.initial import initial
from ..passes.retrace import retrace
from ..passes.select import select
from ..passes.shade import Shown, auxiliary, moved_images, reservoir_color
from ..passes.spatial import spatial
from ..passes.temporal import Previous, temporal
from ..paths.camera import Camera
from ..paths.grid import grid_of
from ..paths.primary_hit import Primary, PrimaryHit, no_primary_hit
from ..paths.settings import PathLimits
from ..resampling.pairwise import PairEstimators, Sharing
from ..resampling.reservoir import Reservoir, empty_reservoir
from ..sampling.dither import Dither
from ..sampling.streams import FrameKey
from ..shifts.mapping import ShiftMapping
from ..shifts.scope import Scope
from .parameters import Parameters


@dataclass
class History:
    """What a frame leaves to the next one, one lane per pixel.

    Fields: ``reservoirs``, ``hits``, ``colors`` (for selection; None without it), ``learnt`` (None
    where candidates are neither guided nor ended by what is known).
    """

    reservoirs: Reservoir
    hits: PrimaryHit
    colors: ColorHistory | None
    learnt: Learnt | None


@dataclass
class Setting:
    """What both stages of a frame are given.

    Fields: ``scene``, ``sensor`` (samples wavelengths; None where there are none), ``now`` (the
    frame's primary hits), ``key``, ``dither`` (of the paths' first random numbers; None without).
    """

    scene: mi.Scene
    sensor: mi.Sensor | None
    now: Primary
    key: FrameKey
    dither: Dither | None


@dataclass
class Beside:
    """What a frame shows and counts beside what its reservoirs hold.

    Fields: ``direct`` (light seen directly, and candidates that are not finite), ``alpha``,
    ``refused`` (how many candidates and paths of the history were not finite), ``cut`` (pixels with
    a path that ends because records have no room for more), ``lit`` (pixels whose candidates carry
    light), ``candidates`` (what these alone would show; 0 where that is not asked for).
    """

    direct: mi.Color3f
    alpha: mi.Float
    refused: mi.UInt32
    cut: mi.Bool
    lit: mi.Bool
    candidates: mi.Color3f


@dataclass
class Sampled:
    """A frame after temporal reuse.

    Fields: ``reservoirs``, ``outcomes`` (of the temporal shifts), ``matched`` (pixels that found
    their history), ``flow`` (previous minus current film position [pixels]), ``colors`` (at each
    pixel's previous place; None without selection), ``beside``, ``learnt`` (by earlier frames),
    ``findings`` (what this one can teach).
    """

    reservoirs: Reservoir
    outcomes: list[mi.UInt32]
    matched: mi.Bool
    flow: mi.Vector2f
    colors: ColorHistory | None
    beside: Beside
    learnt: Learnt | None
    findings: Findings | None


@dataclass
class Frame:
    """A rendered frame.

    Fields: ``color``, ``auxiliary`` (channels), ``outcomes`` (of the temporal pass and of each
    spatial round, 3 bits a shift), ``matched`` (pixels that found their history), ``mutated`` (None
    without mutations), ``beside``, ``history``.
    """

    color: mi.Color3f
    auxiliary: list[mi.Float]
    outcomes: list[list[mi.UInt32]]
    matched: mi.Bool
    mutated: Mutated | None
    beside: Beside
    history: History


@dataclass(frozen=True)
class Plan:
    """What stays the same from frame to frame.

    Attributes
    ----------
    parameters : Parameters
    limits : PathLimits
    mapping : ShiftMapping
    width, height : int
        Size of the crop window [pixels].
    """

    parameters: Parameters
    limits: PathLimits
    mapping: ShiftMapping
    width: int
    height: int

    def scope(self, setting: Setting) -> Scope:
        """The scope of a stage."""
        return Scope(
            setting.scene,
            setting.sensor,
            self.mapping,
            self.limits,
            grid_of(self.width, self.height),
            setting.key,
            setting.dither,
        )

    def mutations(self) -> MutationPlan:
        """How paths are mutated."""
        parameters = self.parameters
        return MutationPlan(
            MoveReconnectionVertex(parameters.mutation_step),
            parameters.mutations,
            parameters.mutation_interval,
            parameters.mutation_acceptance,
            parameters.blue_noise_weight,
        )


def no_history(scene: mi.Scene, pixels: int, parameters: Parameters) -> History:
    """A history without paths, with the structure that later frames have."""
    index = dr.zeros(mi.UInt32, pixels)
    history = History(
        dr.gather(Reservoir, empty_reservoir(parameters.mutates), index),
        dr.gather(PrimaryHit, no_primary_hit(), index),
        dr.gather(ColorHistory, no_color_history(), index) if parameters.selects else None,
        nothing_learnt(scene, parameters.guiding, parameters.roulette == "contribution"),
    )
    dr.make_opaque(history)
    return history


def sample_paths(
    plan: Plan, setting: Setting, history: History, camera: Camera | None, spp: mi.UInt32
) -> Sampled:
    """First half of a frame: candidates and temporal reuse. The history is not needed after it.

    Parameters
    ----------
    history : History
        What the previous frame left.
    camera : Camera or None
        The previous frame's camera; None where the sensor's history cannot be followed.
    spp : UInt32
        Candidate trees per pixel.
    """
    parameters, scope, now = plan.parameters, plan.scope(setting), setting.now
    policy = policy_of(history.learnt, plan.limits.rr_depth, not parameters.retrace_history)
    candidates = initial(scope, now.hit, spp, policy, parameters.mutates)
    reservoirs, refused = candidates.reservoirs, candidates.refused
    direct = now.emitted + refused.color
    beside = Beside(
        direct,
        dr.maximum(now.backdrop, candidates.coverage),
        refused.count,
        candidates.cut if parameters.cuts else mi.Bool(False),
        reservoirs.weight > 0,
        direct + reservoir_color(reservoirs) if parameters.shows("candidates") else mi.Color3f(0),
    )
    dr.eval(reservoirs, beside)
    learnt = history.learnt
    findings = None if learnt is None else findings_of(policy, reservoirs)
    if not parameters.temporal or camera is None:
        pixels = scope.grid.size
        nowhere = Motion(dr.zeros(mi.UInt32, pixels), dr.zeros(mi.Bool, pixels), mi.Vector2f(0))
        colors = _colors_at(history, nowhere)
        return Sampled(
            reservoirs, [], nowhere.valid, nowhere.flow, colors, beside, learnt, findings
        )

    motion = reproject(scope.grid, now, history.hits, camera)
    before = dr.gather(Reservoir, history.reservoirs, motion.pixel, motion.valid)
    hit_before = dr.gather(PrimaryHit, history.hits, motion.pixel, motion.valid)
    if parameters.retrace_history:
        before, lost = retrace(scope, before, hit_before, motion.valid)
        beside.refused += dr.select(lost, mi.UInt32(1), 0)
        dr.eval(before, beside)
    previous = Previous(before, hit_before, motion.valid)
    reservoirs, outcome = temporal(scope, reservoirs, now.hit, previous, parameters.confidence_cap)
    flow = motion.flow if parameters.aovs else mi.Vector2f(0)
    colors = _colors_at(history, motion)
    sampled = Sampled(reservoirs, [outcome], motion.valid, flow, colors, beside, learnt, findings)
    dr.eval(sampled)
    return sampled


def learn_paths(plan: Plan, setting: Setting, learnt: Learnt, findings: Findings) -> Learnt:
    """Between the halves, in frames that teach: what later frames know."""
    return taught(learnt, findings, setting.now.hit, plan.parameters.retrace_history)


def share_paths(
    plan: Plan, setting: Setting, sampled: Sampled, layouts: list[Any], turn: mi.UInt32
) -> Frame:
    """Second half of a frame: mutations, spatial reuse and shading.

    Parameters
    ----------
    sampled : Sampled
        What the first half left.
    layouts : list
        What the strategy of ``neighbor_sampling`` finds neighbours with, in each round.
    turn : UInt32
        Running number of the frame; decides which pixels are mutated where not all are.
    """
    parameters, scope, now = plan.parameters, plan.scope(setting), setting.now
    reservoirs, outcomes = sampled.reservoirs, [sampled.outcomes]
    mutated = None
    if parameters.mutates:
        reservoirs, mutated = decorrelate(scope, reservoirs, now.hit, plan.mutations(), turn)
        dr.eval(reservoirs, mutated)

    kinds = [kind for _, kind in parameters.images]
    moved = moved_images(kinds, sampled.reservoirs, reservoirs)
    dr.eval(moved)

    color = reservoir_color(reservoirs)
    estimators = PairEstimators([color], [mi.Bool(True)])
    strategy = STRATEGIES[parameters.neighbor_sampling]
    sharing = Sharing(scope, now.hit, parameters.spatial_neighbors)
    first = color if parameters.shows("first_round") else mi.Color3f(0)
    kept = reservoirs
    for index, layout in enumerate(layouts):
        merged = spatial(sharing, strategy, layout, reservoirs, dr.opaque(mi.UInt32, index))
        reservoirs, color, estimators = merged.reservoirs, merged.color, merged.estimators
        outcomes.append(merged.outcomes)
        first = color if index == 0 and parameters.shows("first_round") else first
        dr.eval(reservoirs, color, merged.outcomes, estimators if parameters.selects else None)
        if index < parameters.spatial_feedback:
            kept = reservoirs

    colors = None
    if sampled.colors is not None:
        color, colors = select(
            scope, now.hit, color, estimators, sampled.colors, parameters.retrace_history
        )

    past = now.emitted + (mi.Color3f(0) if colors is None else colors.color)
    beside = sampled.beside
    color, first = color + beside.direct, first + beside.direct
    shown = Shown(now.hit, sampled.flow, reservoirs, past, beside.candidates, first)
    extra = auxiliary(kinds, moved, shown)
    beside = replace(beside, refused=dr.sum(beside.refused))
    dr.eval(color, extra, beside)
    history = History(kept, now.hit, colors, sampled.learnt)
    return Frame(color, extra, outcomes, sampled.matched, mutated, beside, history)


def _colors_at(history: History, motion: Motion) -> ColorHistory | None:
    if history.colors is None:
        return None
    return dr.gather(ColorHistory, history.colors, motion.pixel, motion.valid)
