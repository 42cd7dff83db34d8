"""One frame: the sequence of passes, as a function of plain data."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi

from ..passes.alternate import decorrelate_alternating
from ..passes.blue_noise_rule import mutate_by_rule
from ..passes.color_history import ColorHistory, clamped, no_color_history, relit, remember
from ..passes.decorrelate import Mutated, metropolis_hastings
from ..passes.initial import initial
from ..passes.neighborhood import similar_neighbors
from ..passes.neighbors import SAMPLING, spatial
from ..passes.primary import Primary
from ..passes.reproject import reproject
from ..passes.retrace import retrace
from ..passes.selection import select
from ..passes.shade import Shown, auxiliary, moved_images, reservoir_color
from ..passes.spatial import Pixels
from ..passes.temporal import temporal
from ..paths.camera import Camera
from ..paths.primary_hit import PrimaryHit, no_primary_hit
from ..paths.settings import PathLimits
from ..resampling.reservoir import Reservoir, empty_reservoir
from ..sampling.dither import Dither
from ..shifts.mapping import ShiftMapping
from .parameters import Parameters


@dataclass
class History:
    """What a frame leaves to the next one, one lane per pixel.

    Fields: ``reservoirs``, ``hits``, ``colors`` (for selection; None without it).
    """

    reservoirs: Reservoir
    hits: PrimaryHit
    colors: ColorHistory | None


@dataclass
class Sampled:
    """A frame after temporal reuse.

    Fields: ``reservoirs``, ``outcomes`` (list of ``UInt32``: outcomes of the temporal shifts),
    ``matched`` (``Bool``: pixels that found their history), ``flow`` (``Vector2f``, previous minus
    current film position [pixels]), ``colors`` (:class:`ColorHistory` at each pixel's previous
    place; None without selection).
    """

    reservoirs: Reservoir
    outcomes: list[Any]
    matched: Any
    flow: Any
    colors: ColorHistory | None


@dataclass
class Frame:
    """A rendered frame.

    Fields: ``color`` (``Color3f``), ``alpha`` (``Float``), ``auxiliary`` (list of ``Float``),
    ``outcomes`` (of the temporal pass and of each spatial round, 3 bits a shift), ``matched``
    (``Bool``: pixels that found their history), ``mutated`` (:class:`Mutated`, if there were
    mutations), ``history`` (:class:`History`).
    """

    color: Any
    alpha: Any
    auxiliary: list[Any]
    outcomes: list[Any]
    matched: Any
    mutated: Mutated | None
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


def no_history(pixels: int, continued: bool, colors: bool) -> History:
    """A history without paths, with the structure that later frames have.

    ``continued``: whether its paths carry the continuation that mutations need; ``colors``: whether
    it has the colours that selection needs.
    """
    index = dr.zeros(mi.UInt32, pixels)
    history = History(
        dr.gather(Reservoir, empty_reservoir(continued), index),
        dr.gather(PrimaryHit, no_primary_hit(), index),
        dr.gather(ColorHistory, no_color_history(), index) if colors else None,
    )
    dr.make_opaque(history)
    return history


def sample_paths(
    plan: Plan,
    scene: mi.Scene,
    sensor: mi.Sensor | None,
    now: Primary,
    history: History,
    camera: Camera | None,
    sample: Any,
    seed: Any,
    spp: Any,
    dither: Dither | None,
) -> Sampled:
    """First half of a frame: candidates and temporal reuse. The history is not needed after it.

    Parameters
    ----------
    sensor : Sensor or None
        Samples wavelengths; only spectral variants need it.
    now : Primary
        The frame's primary hits.
    history : History
        What the previous frame left.
    camera : Camera or None
        The previous frame's camera; None where the sensor's history cannot be followed.
    sample, seed, spp : UInt32
        Running number of the frame's first sample, the user's seed, candidate trees per pixel.
    dither : Dither or None
        Dithers the paths' first random numbers.
    """
    parameters, mapping = plan.parameters, replace(plan.mapping, dither=dither)
    reservoirs = initial(
        scene, sensor, now.hit, sample, seed, spp, plan.limits, mapping, parameters.mutates
    )
    dr.eval(reservoirs)
    if not parameters.temporal or camera is None:
        nowhere = dr.zeros(mi.Bool, plan.width * plan.height)
        colors = _colors_at(history, dr.zeros(mi.UInt32, plan.width * plan.height), nowhere)
        return Sampled(reservoirs, [], nowhere, mi.Vector2f(0), colors)

    motion = reproject(now, history.hits, camera, _size(plan))
    before = dr.gather(Reservoir, history.reservoirs, motion.pixel, motion.valid)
    hit_before = dr.gather(PrimaryHit, history.hits, motion.pixel, motion.valid)
    if parameters.retrace_history:
        before = retrace(scene, sensor, before, hit_before, mapping, motion.valid)
        dr.eval(before)
    reservoirs, outcome = temporal(
        scene,
        sensor,
        reservoirs,
        now.hit,
        before,
        hit_before,
        motion.valid,
        parameters.confidence_cap,
        sample,
        seed,
        mapping,
    )
    flow = motion.flow if parameters.aovs else mi.Vector2f(0)
    colors = _colors_at(history, motion.pixel, motion.valid)
    sampled = Sampled(reservoirs, [outcome], motion.valid, flow, colors)
    dr.eval(sampled)
    return sampled


def share_paths(
    plan: Plan,
    scene: mi.Scene,
    sensor: mi.Sensor | None,
    now: Primary,
    sampled: Sampled,
    layout: Any,
    sample: Any,
    seed: Any,
    turn: Any,
    dither: Dither | None,
) -> Frame:
    """Second half of a frame: mutations, spatial reuse and shading.

    Parameters
    ----------
    sampled : Sampled
        What the first half left.
    layout : Any
        What the neighbours of spatial reuse are found with, see :data:`SAMPLING`.
    turn : UInt32
        Running number of the frame; decides which pixels are mutated where not all are.
    """
    parameters, mapping = plan.parameters, replace(plan.mapping, dither=dither)
    reservoirs, outcomes = sampled.reservoirs, [sampled.outcomes]
    mutated = None
    if parameters.mutates:
        size = (plan.width, plan.height)
        steps = (parameters.mutations, parameters.mutation_step, sample, seed, mapping)
        if parameters.prefers_energy:
            reservoirs, mutated = mutate_by_rule(
                scene,
                sensor,
                reservoirs,
                now.hit,
                size,
                *steps,
                parameters.blue_noise_weight,
                parameters.updates_energy,
            )
        else:
            reservoirs, mutated = decorrelate_alternating(
                scene,
                sensor,
                reservoirs,
                now.hit,
                size,
                parameters.mutation_interval,
                turn,
                *steps,
                metropolis_hastings,
            )
        dr.eval(reservoirs, mutated)

    kinds = [kind for _, kind in parameters.images]
    moved = moved_images(kinds, sampled.reservoirs, reservoirs)
    dr.eval(moved)

    color = reservoir_color(reservoirs)
    sampling = SAMPLING[parameters.neighbor_sampling]
    pixels = Pixels(
        scene, sensor, now.hit, plan.width, plan.height, parameters.spatial_neighbors, mapping
    )
    for round_index in range(parameters.spatial_rounds if parameters.spatial else 0):
        round_number = dr.opaque(mi.UInt32, round_index)
        reservoirs, color, pairs, shifts = spatial(
            pixels, sampling, layout, reservoirs, round_number, sample, seed
        )
        outcomes.append(shifts)
        dr.eval(reservoirs, color, pairs if parameters.selects else None)

    colors = None
    if sampled.colors is not None:
        size, before = _size(plan), sampled.colors
        alike = similar_neighbors(now.hit, *size)
        if parameters.retrace_history:
            before = replace(before, color=clamped(before.color, color, alike, size[0]))
        colors = remember(before, color)
        dr.eval(colors, alike)
        reference = colors.color
        if parameters.retrace_history:
            further = similar_neighbors(now.hit, *size, step=2)
            reference = relit(reference, color, alike, further, size[0])
        color = select(color, pairs, reference, alike, (plan.width, plan.height), sample, seed)

    color += now.emitted
    past = now.emitted + (mi.Color3f(0) if colors is None else colors.color)
    extra = auxiliary(kinds, moved, Shown(now.hit, sampled.flow, reservoirs, past))
    dr.eval(color, extra)
    return Frame(
        color,
        now.alpha,
        extra,
        outcomes,
        sampled.matched,
        mutated,
        History(reservoirs, now.hit, colors),
    )


def _colors_at(history: History, pixel: Any, valid: Any) -> ColorHistory | None:
    if history.colors is None:
        return None
    return dr.gather(ColorHistory, history.colors, pixel, valid)


def _size(plan: Plan) -> tuple[Any, Any]:
    return dr.opaque(mi.UInt32, plan.width), dr.opaque(mi.UInt32, plan.height)
