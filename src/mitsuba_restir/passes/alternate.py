"""Mutations of the n-th part of the pixels: each frame another set, all of them within n frames.

Which pixels have their turn depends on the frame's number alone. To decide it by what the
reservoirs hold, such as how often a path is duplicated, would be biased.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit
from ..paths.vertex import Vertex
from ..resampling.reservoir import Reservoir
from ..shifts.mapping import ShiftMapping
from ..shifts.pivot import CLASSES
from .decorrelate import Acceptance, Mutated, decorrelate

RUN = 16
"""Neighbouring pixels of a row that have their turn together: as many as a line of the processor's
cache holds, so that what is not mutated is not read either."""


@dataclass
class Moved:
    """The fields of a reservoir that a mutation changes; see :class:`Reservoir`, ``PathRecord``."""

    vertex: Vertex
    wo: Any
    radiance: Any
    light_pdf: Any
    jacobian: Any
    color: Any
    weight: Any


def stride(interval: int) -> int:
    """The s that spreads the points with x + s y = 0 mod ``interval`` most evenly over the plane.

    It maximises the distance of the closest two of them (a good lattice), found by trying all.
    """

    def closest(s: int) -> int:
        rows = range(1, interval + 1)
        steps = [((-s * y) % interval, y) for y in rows]
        return min(interval**2, *(min(x, interval - x) ** 2 + y**2 for x, y in steps))

    return max(range(interval), key=closest)


def pixels_of_set(size: tuple[int, int], interval: int, turn: Any) -> tuple[Any, Any]:
    """The pixels whose turn it is: in row y the runs x with x + s y + turn = 0 mod ``interval``.

    Parameters
    ----------
    size : (int, int)
        Width and height in pixels.
    turn : UInt32
        Number of the frame.

    Returns
    -------
    pixel : UInt32
        Row-major indices; the number of lanes does not depend on the turn.
    inside : Bool
        Lanes that have a pixel; all, where ``RUN`` times the interval divides the width.
    """
    columns = RUN * -(-size[0] // (RUN * interval))
    lane = dr.arange(mi.UInt32, columns * size[1])
    y = lane // dr.opaque(mi.UInt32, columns)
    lane -= y * dr.opaque(mi.UInt32, columns)
    first = interval - 1 - (stride(interval) * y + turn + (interval - 1)) % interval
    x = (lane // RUN * interval + first) * RUN + lane % RUN
    width = dr.opaque(mi.UInt32, size[0])
    return y * width + x, x < width


def decorrelate_alternating(
    scene: mi.Scene,
    sensor: mi.Sensor | None,
    reservoirs: Reservoir,
    hits: PrimaryHit,
    size: tuple[int, int],
    interval: int,
    turn: Any,
    mutations: int,
    step: float,
    sample: Any,
    seed: Any,
    mapping: ShiftMapping,
    acceptance: Acceptance,
) -> tuple[Reservoir, Mutated]:
    """Mutate the paths of the pixels whose turn it is, and leave the others alone.

    Parameters
    ----------
    reservoirs, hits : Reservoir, PrimaryHit
        One lane per pixel; evaluated.
    size, interval, turn
        See :func:`pixels_of_set`.

    Returns
    -------
    reservoirs : Reservoir
        One lane per pixel.
    mutated : Mutated
        One lane per pixel of the set; ``kind`` is the number of classes in a lane without pixel.
    """
    steps = (mutations, step, sample, seed, mapping)
    if interval == 1:
        return decorrelate(scene, sensor, reservoirs, hits, *steps, acceptance)
    pixel, inside = pixels_of_set(size, interval, turn)
    own = dr.gather(Reservoir, reservoirs, pixel, inside)
    there = dr.gather(PrimaryHit, hits, pixel, inside)
    after, mutated = decorrelate(scene, sensor, own, there, *steps, acceptance, pixel)
    mutated.kind = dr.select(inside, mutated.kind, len(CLASSES))
    result = dr.copy(_moved(reservoirs))
    dr.scatter(result, _moved(after), pixel, inside & (mutated.accepted > 0))
    return _with_moved(reservoirs, result), mutated


def _moved(reservoirs: Reservoir) -> Moved:
    path = reservoirs.path
    return Moved(
        path.vertex,
        path.wo,
        path.radiance,
        path.light_pdf,
        path.jacobian,
        reservoirs.color,
        reservoirs.weight,
    )


def _with_moved(reservoirs: Reservoir, moved: Moved) -> Reservoir:
    path = replace(
        reservoirs.path,
        vertex=moved.vertex,
        wo=moved.wo,
        radiance=moved.radiance,
        light_pdf=moved.light_pdf,
        jacobian=moved.jacobian,
    )
    return Reservoir(path, moved.color, moved.weight, reservoirs.confidence)
