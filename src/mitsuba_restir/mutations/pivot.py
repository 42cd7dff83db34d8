"""The vertex that a mutation pivots on: the last before the reconnection vertex, replayed once."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit
from ..paths.record import (
    Kind,
    PathRecord,
    continuation_of,
    edge_count,
    kind_of,
    next_kind_of,
    reconnection_index,
)
from ..paths.vertex import exists, sight
from ..sampling.codes import Codes
from ..sampling.streams import Stream
from ..shifts.connectability import Link
from ..shifts.mapping import Outcome
from ..shifts.replay import at_primary, replay
from ..shifts.scope import Scope


class MutationClass(Codes):
    """What follows the vertex that a mutation moves, and what stays."""

    NONE = 0  # there is no path
    FIXED = 1  # nothing of the path can be moved
    BEFORE_SURFACE = 2  # a surface
    BEFORE_LIGHT_SAMPLE = 3  # the numbers with which a light is sampled
    BEFORE_LIGHT = 4  # a light that the next bounce finds
    BEFORE_ENVIRONMENT = 5  # the environment, in the direction that the next bounce takes
    ON_LIGHT = 6  # nothing: the vertex is on the light, or is the environment
    LIGHT_NUMBERS = 7  # no vertex is moved, but the numbers with which a light is sampled


@dataclass
class Pivot:
    """The surroundings of a path's reconnection vertex, which mutations leave alone.

    Fields: ``si`` (interaction at x_{k-1}), ``throughput`` (up to it), ``arrival`` (the pair before
    it), ``limit`` (its criterion's vertex limit), ``footprint`` (the pixel's), ``stream`` (the
    path's), ``lambdas`` (its wavelengths), ``valid`` (the prefix could be replayed), ``next_si``
    (interaction at x_{k+1}, as if it were seen from here; its point is the same from others).
    """

    si: mi.SurfaceInteraction3f
    throughput: mi.Spectrum
    arrival: Link
    limit: mi.Float
    footprint: mi.Float
    stream: Stream
    lambdas: mi.Spectrum
    valid: mi.Bool
    next_si: mi.SurfaceInteraction3f


def movable(path: PathRecord) -> mi.Bool:
    """Lanes whose path a mutation can change.

    Not movable: a path that finds its light by replay alone, and one whose vertex x_{k+1} scatters
    by a delta lobe, which fixes the direction that must reach it.
    """
    kind = kind_of(path)
    fixed = (kind == Kind.FAR) & (next_kind_of(path) == Kind.EMPTY)
    return (kind != Kind.EMPTY) & (kind != Kind.REPLAY_HIT) & ~fixed


def mutation_class(path: PathRecord) -> mi.UInt32:
    """What a mutation of the path would keep: a member of :class:`MutationClass`."""
    kind, following = kind_of(path), continuation_of(path)
    named = {
        Kind.EMPTY: MutationClass.NONE,
        Kind.REPLAY_HIT: MutationClass.FIXED,
        Kind.FAR: MutationClass.BEFORE_SURFACE,
        Kind.NEE: MutationClass.BEFORE_LIGHT_SAMPLE,
        Kind.LIGHT: MutationClass.ON_LIGHT,
        Kind.ENVIRONMENT: MutationClass.ON_LIGHT,
        Kind.REPLAY_NEE: MutationClass.LIGHT_NUMBERS,
    }
    # What is left is HIT.
    result = dr.select(
        exists(following.vertex),
        mi.UInt32(MutationClass.BEFORE_LIGHT),
        MutationClass.BEFORE_ENVIRONMENT,
    )
    for value, name in named.items():
        result = dr.select(kind == value, name, result)
    return dr.select((kind == Kind.FAR) & ~movable(path), MutationClass.FIXED, result)


def pivot_of(scope: Scope, path: PathRecord, hit: PrimaryHit, active: mi.Bool) -> Pivot:
    """Replay the path's prefix from its own primary hit."""
    stream = scope.stream(path.name)
    lambdas, response_weight = scope.wavelengths(stream)
    by_numbers = kind_of(path) == Kind.REPLAY_NEE
    bounces = dr.select(by_numbers, edge_count(path), reconnection_index(path)) - 2
    head = replay(scope, stream, at_primary(hit, lambdas, response_weight), bounces, active)
    si = head.pi.compute_surface_interaction(head.ray, active=active)
    limit = scope.mapping.criterion.vertex_limit(si, si.bsdf(), active)
    arrival = scope.mapping.link(head.start, head.ray, si, limit, head.index, hit.footprint)
    valid = active & (head.outcome == Outcome.OK) & si.is_valid()
    return Pivot(
        si,
        head.throughput,
        arrival,
        limit,
        hit.footprint,
        stream,
        lambdas,
        valid,
        _next_interaction(path, si, valid),
    )


def _next_interaction(
    path: PathRecord, si: mi.SurfaceInteraction3f, active: mi.Bool
) -> mi.SurfaceInteraction3f:
    following, kind = continuation_of(path).vertex, kind_of(path)
    used = active & ((kind == Kind.FAR) | (kind == Kind.HIT)) & exists(following)
    return sight(following, lambda _: si.p, si.wavelengths, used).si
