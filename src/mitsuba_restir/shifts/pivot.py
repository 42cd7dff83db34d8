"""The vertex that a mutation pivots on: the last before the reconnection vertex, replayed once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from ..paths import record as kinds
from ..paths.primary_hit import PrimaryHit
from ..paths.record import (
    PathRecord,
    continuation_of,
    edge_count,
    kind_of,
    next_kind_of,
    reconnection_index,
)
from ..paths.spectrum import wavelengths
from ..paths.vertex import exists
from ..sampling.streams import Stream, path_stream
from .connectability import Link, link
from .mapping import OK, ShiftMapping
from .replay import replay

CLASSES = ("none", "E", "A", "B", "C1", "C2", "D", "E1")
"""What follows the moved vertex: A a surface, B a sampled light, C1 a light found by a bounce, C2
the environment found by a bounce, D nothing (it is on the light), E1 the numbers of a sampled light
are moved instead, E nothing can be moved, none: no path."""


@dataclass
class Pivot:
    """A path's vertex x_{k-1} in its own pixel.

    Fields: ``si`` (its interaction), ``throughput`` (``Spectrum``, up to it), ``arrival``
    (:class:`Link` of the pair before it), ``limit`` (its criterion's vertex limit), ``footprint``
    (the pixel's), ``stream`` (the path's), ``lambdas`` (its wavelengths), ``valid`` (``Bool``).
    """

    si: Any
    throughput: Any
    arrival: Link
    limit: Any
    footprint: Any
    stream: Stream
    lambdas: Any
    valid: Any


def movable(path: PathRecord) -> Any:
    """Lanes whose path a mutation can change.

    Not movable: a path that finds its light by replay alone, and one whose vertex x_{k+1} scatters
    by a delta lobe, which fixes the direction that must reach it.
    """
    kind = kind_of(path)
    fixed = (kind == kinds.FAR) & (next_kind_of(path) == kinds.EMPTY)
    return (kind != kinds.EMPTY) & (kind != kinds.REPLAY_HIT) & ~fixed


def mutation_class(path: PathRecord) -> Any:
    """Index into :data:`CLASSES` of what a mutation of the path would keep (``UInt32``)."""
    kind, following = kind_of(path), continuation_of(path)
    named = {
        kinds.EMPTY: 0,
        kinds.REPLAY_HIT: 1,
        kinds.FAR: 2,
        kinds.NEE: 3,
        kinds.LIGHT: 6,
        kinds.ENVIRONMENT: 6,
        kinds.REPLAY_NEE: 7,
    }
    result = dr.select(exists(following.vertex), mi.UInt32(4), 5)  # HIT
    for value, index in named.items():
        result = dr.select(kind == value, index, result)
    return dr.select((kind == kinds.FAR) & ~movable(path), 1, result)


def pivot_of(
    scene: mi.Scene,
    sensor: mi.Sensor | None,
    path: PathRecord,
    hit: PrimaryHit,
    mapping: ShiftMapping,
    active: Any,
) -> Pivot:
    """Replay the path's prefix from its own primary hit."""
    stream = path_stream(path.pixel, path.sample, path.seed, mapping.dither)
    lambdas, response_weight = wavelengths(sensor, stream)
    by_numbers = kind_of(path) == kinds.REPLAY_NEE
    bounces = dr.select(by_numbers, edge_count(path), reconnection_index(path)) - 2
    head = replay(scene, stream, hit, lambdas, response_weight, bounces, mapping, active)
    si = head.pi.compute_surface_interaction(head.ray, active=active)
    limit = mapping.criterion.vertex_limit(si, si.bsdf(), active)
    arrival = link(
        mapping.criterion, head.start, si, limit, head.index, mapping.last_index, hit.footprint
    )
    valid = active & (head.outcome == OK) & si.is_valid()
    return Pivot(si, head.throughput, arrival, limit, hit.footprint, stream, lambdas, valid)
