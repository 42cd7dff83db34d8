"""One frame: the sequence of passes, as a function of plain data.

Temporal reuse is part of the first half, except over an edit of the scene. There the target
function of the history is that of the scene before the edit, which has to be in place while it is
evaluated: :func:`look_back` runs in that scene, between :func:`sample_paths` and
:func:`reuse_paths`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi

from ..guiding.policy import Findings, Learnt, findings_of, policy_of, taught
from ..neighbors.color_history import carried
from ..neighbors.reproject import nowhere, reproject
from ..neighbors.strategies import STRATEGIES
from ..passes.decorrelate import decorrelate
from ..passes.initial import initial
from ..passes.primary import CameraRays, primary
from ..passes.retrace import retrace
from ..passes.select import select
from ..passes.shade import Shown, auxiliary, moved_images, reservoir_color
from ..passes.spatial import spatial
from ..passes.temporal import (
    Exchange,
    Previous,
    merge_history,
    reusable,
    shareable,
    temporal,
)
from ..paths.camera import Camera
from ..paths.moves import Moves
from ..paths.primary_hit import Primary
from ..paths.spectrum import Spectra
from ..resampling.pairwise import Sharing
from ..resampling.reservoir import Reservoir
from ..shifts.carry import Source, carried_back, carried_forth, kept_pdf
from .frame_data import (
    Beside,
    Changed,
    Found,
    Frame,
    History,
    LookedBack,
    Plan,
    Rounds,
    Sampled,
    Setting,
    Shared,
    Waiting,
)


def meet_surfaces(
    plan: Plan, scene: mi.Scene, rays: CameraRays, spectra: Spectra | None
) -> Primary:
    """Before both halves of a frame: primary hits."""
    now = primary(scene, rays, spectra, plan.parameters.hide_emitters, plan.form.compact)
    dr.eval(now)
    return now


def sample_paths(
    plan: Plan,
    setting: Setting,
    history: History,
    camera: Camera | None,
    spp: mi.UInt32,
    moves: Moves | None,
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
    moves : Moves or None
        What an edit since the previous frame has moved, if its scene can be looked back at: the
        history is then left waiting.
    """
    parameters, scope, now = plan.parameters, plan.scope(setting), setting.now
    policy = policy_of(history.learnt, plan.limits.rr_depth, not parameters.retrace_history)
    candidates = initial(scope, now.hit, spp, policy, plan.form)
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
    motion = nowhere(scope.grid)
    if parameters.temporal and camera is not None:
        motion = reproject(scope.grid, now, history.hits, camera, moves)
    sampled = Sampled(
        reservoirs,
        [],
        Found(motion.valid, motion.moved, motion.lost),
        motion.flow if parameters.aovs else mi.Vector2f(0),
        None if history.colors is None else carried(scope.grid, history.colors, motion),
        beside,
        learnt,
        findings,
        None,
    )
    if not parameters.temporal or camera is None:
        return sampled

    before = dr.gather(Reservoir, history.reservoirs, motion.pixel, motion.valid)
    hit_before = history.hits.at(motion.pixel, motion.valid)
    previous = Previous(before, hit_before, motion.valid)
    if moves is not None:
        kept = kept_pdf(scope, reservoirs.path, now.hit, shareable(reservoirs, previous))
        sampled.waiting = Waiting(previous, kept)
        dr.eval(sampled)
        return sampled

    if parameters.retrace_history:
        previous.reservoirs, lost = retrace(scope, before, hit_before, motion.valid)
        beside.refused += dr.select(lost, mi.UInt32(1), 0)
        dr.eval(previous, beside)
    sampled.reservoirs, outcome = temporal(
        scope, reservoirs, now.hit, previous, parameters.confidence_cap
    )
    sampled.outcomes = [outcome]
    dr.eval(sampled)
    return sampled


def look_back(plan: Plan, setting: Setting, sampled: Sampled, moves: Moves) -> LookedBack:
    """The frame's own paths in the scene before the edit, which is in place for this."""
    scope, waiting = plan.scope(setting), sampled.waiting
    assert waiting is not None
    previous, current = waiting.previous, sampled.reservoirs
    source = Source(current.path, waiting.kept_pdf, shareable(current, previous))
    backward = carried_back(scope, source, previous.hit, moves).shifted
    kept = kept_pdf(scope, previous.reservoirs.path, previous.hit, reusable(previous))
    looked = LookedBack(backward, kept)
    dr.eval(looked)
    return looked


def reuse_paths(
    plan: Plan, setting: Setting, sampled: Sampled, looked: LookedBack, moves: Moves
) -> Sampled:
    """Temporal reuse over an edit, in the scene after it."""
    scope, waiting, hit = plan.scope(setting), sampled.waiting, setting.now.hit
    assert waiting is not None
    previous = waiting.previous
    source = Source(previous.reservoirs.path, looked.kept_pdf, reusable(previous))
    carried = carried_forth(scope, source, hit, moves)
    exchange = Exchange(carried.path, carried.shifted, looked.backward)
    reservoirs, outcome = merge_history(
        scope, sampled.reservoirs, previous, exchange, plan.parameters.confidence_cap
    )
    sampled = replace(sampled, reservoirs=reservoirs, outcomes=[outcome], waiting=None)
    dr.eval(sampled)
    return sampled


def learn_paths(plan: Plan, setting: Setting, learnt: Learnt, findings: Findings) -> Learnt:
    """Between the halves, in frames that teach: what later frames know."""
    return taught(learnt, findings, setting.now.hit, plan.parameters.retrace_history)


def mutate_paths(plan: Plan, setting: Setting, before: Reservoir, turn: mi.UInt32) -> Changed:
    """Second half of a frame, its beginning: mutations.

    Parameters
    ----------
    before : Reservoir
        What the first half left.
    turn : UInt32
        Running number of the frame; decides which pixels are mutated where not all are.
    """
    parameters, reservoirs, mutated = plan.parameters, before, None
    if parameters.mutates:
        scope, hit = plan.scope(setting), setting.now.hit
        reservoirs, mutated = decorrelate(scope, reservoirs, hit, plan.mutations(), turn)
        dr.eval(reservoirs, mutated)
    kinds = [kind for _, kind in parameters.images]
    changed = Changed(reservoirs, mutated, moved_images(kinds, before, reservoirs))
    dr.eval(changed)
    return changed


def share_paths(
    plan: Plan, setting: Setting, reservoirs: Reservoir, layout: Any, index: mi.UInt32
) -> Shared:
    """One round of spatial reuse.

    Parameters
    ----------
    layout : Any
        What the strategy of ``neighbor_sampling`` finds neighbours with in this round.
    index : UInt32
        Number of the round.
    """
    parameters = plan.parameters
    sharing = Sharing(plan.scope(setting), setting.now.hit, parameters.spatial_neighbors)
    strategy = STRATEGIES[parameters.neighbor_sampling]
    merged = spatial(sharing, strategy, layout, reservoirs, index)
    chosen_from = parameters.selects or plan.keeps_rounds
    estimators = [merged.estimators] if chosen_from else []
    shared = Shared(merged.reservoirs, merged.color, estimators, merged.outcomes)
    dr.eval(shared)
    return shared


def show_paths(
    plan: Plan,
    setting: Setting,
    sampled: Sampled,
    changed: Changed,
    rounds: Rounds,
    kept: tuple[Reservoir, Reservoir],
) -> Frame:
    """Second half of a frame, its end: selection and shading.

    Parameters
    ----------
    sampled : Sampled
        What the first half left.
    kept : (Reservoir, Reservoir)
        What spatial reuse ends with, and what goes into the history.
    """
    parameters, scope, now = plan.parameters, plan.scope(setting), setting.now
    reservoirs, kept_back = kept
    shown_colors = rounds.colors or [reservoir_color(reservoirs)]
    color, first, colors = shown_colors[-1], shown_colors[0], None
    if sampled.colors is not None:
        sigma, changing = parameters.blue_noise_sigma, parameters.retrace_history
        color, colors = select(scope, now.hit, rounds.known, sampled.colors, sigma, changing)

    past = now.emitted + (mi.Color3f(0) if colors is None else colors.color)
    beside = sampled.beside
    color, first = color + beside.direct, first + beside.direct
    shown = Shown(now.hit, sampled.flow, reservoirs, past, beside.candidates, first)
    extra = auxiliary([kind for _, kind in parameters.images], changed.moved, shown)
    beside = replace(beside, refused=dr.sum(beside.refused))
    dr.eval(color, extra, beside)
    history = History(kept_back, now.hit, colors, sampled.learnt)
    return Frame(color, extra, rounds.outcomes, sampled.found, changed.mutated, beside, history)
