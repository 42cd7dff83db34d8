"""The path record: what must be stored of a path so that any pixel can evaluate it again.

A path x0 (camera), x1 (primary hit), ..., x_d (light) is described by the stream that generated its
prefix, its reconnection vertex x_k, the direction leaving it, and the light arriving along it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi

from ..sampling.absent import Absent
from ..sampling.codes import Codes
from ..sampling.streams import ROUNDING, PathName, Stream
from .packing import no_radiance, unpack_direction, unpack_radiance
from .vertex import Spot, Stored, nowhere


class Kind(Codes):
    """How a path ends relative to its reconnection vertex x_k."""

    EMPTY = 0  # no path
    REPLAY_NEE = 1  # no x_k; the light is sampled from the last replayed vertex
    REPLAY_HIT = 2  # no x_k; the last replayed bounce finds the light
    FAR = 3  # the light is two or more vertices after x_k
    NEE = 4  # the light is sampled from x_k
    HIT = 5  # the bounce from x_k finds the light
    LIGHT = 6  # x_k is itself on a light, found by a bounce
    ENVIRONMENT = 7  # x_k is the environment, found by a bounce


MAX_EDGES = 0xFFF
"""Longest path that a record can describe (12 bits)."""


@dataclass(frozen=True)
class Form:
    """What records have.

    Attributes
    ----------
    continued : bool
        A :class:`Continuation`.
    compact : bool
        Small vertices.
    seeded : bool
        The seed of their streams by itself, which dithering asks for.
    """

    continued: bool
    compact: bool
    seeded: bool = False


@dataclass
class Continuation:
    """What follows the reconnection vertex, kept so that x_k can be moved (32 bytes a path in
    compact scenes, 44 in others).

    Fields: ``vertex`` (x_{k+1}: a surface of a ``FAR`` path, the light of a ``HIT`` path),
    ``leaving`` (packed direction leaving it), ``arriving`` (packed radiance) and ``light_pdf`` (the
    light arriving from there, as :class:`PathRecord` has them for x_k; their kind is in the
    record's ``info``).
    """

    vertex: Stored
    leaving: mi.Point2f
    arriving: Any
    light_pdf: mi.Float

    @property
    def radiance(self) -> mi.Spectrum:
        """Light arriving along ``wo``, see :class:`PathRecord`."""
        return unpack_radiance(self.arriving)

    @property
    def wo(self) -> mi.Vector3f:
        """Direction leaving the vertex (world)."""
        return unpack_direction(self.leaving)


@dataclass
class PathRecord:
    """A path that can be replayed or reconnected, one per lane.

    Fields: ``name`` names the prefix's stream. ``info`` packs kind, technique, k and d. ``vertex``
    is x_k, ``leaving`` the packed direction that leaves it (for ``ENVIRONMENT`` the one that leaves
    x_{k-1}). ``arriving`` is the packed radiance from there: the suffix's throughput and MIS weight
    are part of it for ``FAR``, emission alone for ``HIT`` and ``ENVIRONMENT``, emission over the
    light pdf for ``NEE``; unused for ``LIGHT``, whose emission depends on the direction.
    ``light_pdf`` [1/sr] is the MIS partner of ``NEE``, ``HIT`` and ``ENVIRONMENT``; 0 stands for a
    light that only one technique can find. ``factor`` is p_{k-1} G p_k, this path's own part of the
    reconnection Jacobian. A ``REPLAY_NEE`` path has no such direction; the two numbers that sampled
    its light are kept there.
    ``next`` (:class:`Continuation`) is :class:`Absent` where paths are never mutated.
    """

    name: PathName
    info: mi.UInt32
    vertex: Stored
    leaving: mi.Point2f
    arriving: Any
    light_pdf: mi.Float
    factor: mi.Float
    next: Continuation | Absent

    @property
    def radiance(self) -> mi.Spectrum:
        """Light arriving along ``wo``, as all who use the path know it."""
        return unpack_radiance(self.arriving)

    @property
    def wo(self) -> mi.Vector3f:
        """Direction leaving x_k, or x_{k-1} to the environment (world)."""
        return unpack_direction(self.leaving)


def form_of(record: PathRecord) -> Form:
    """The form of a record."""
    return Form(
        isinstance(record.next, Continuation),
        isinstance(record.vertex, Spot),
        not isinstance(record.name.seed, Absent),
    )


def no_continuation(form: Form) -> Continuation:
    """A continuation that leads nowhere."""
    return Continuation(nowhere(form.compact), dr.zeros(mi.Point2f), no_radiance(), mi.Float(0))


def empty_record(form: Form) -> PathRecord:
    """The record of no path (``Kind.EMPTY``)."""
    return PathRecord(
        PathName(mi.UInt32(0), mi.UInt32(0), mi.UInt32(0) if form.seeded else Absent()),
        mi.UInt32(0),
        nowhere(form.compact),
        dr.zeros(mi.Point2f),
        no_radiance(),
        mi.Float(0),
        mi.Float(0),
        no_continuation(form) if form.continued else Absent(),
    )


def pack_info(
    kind: mi.UInt32, by_nee: mi.Bool | bool, k: mi.UInt32, edges: mi.UInt32, next_kind: mi.UInt32
) -> mi.UInt32:
    """Pack kind (3 bits), "ends by NEE" (1), k (12), edges d (12) and the next kind (3)."""
    nee_bit = dr.select(by_nee, mi.UInt32(8), 0)
    return mi.UInt32(kind) | nee_bit | (k << 4) | (edges << 16) | (mi.UInt32(next_kind) << 28)


def kind_of(record: PathRecord) -> mi.UInt32:
    """Kind of the path (a member of :class:`Kind`)."""
    return record.info & 7


def ends_by_nee(record: PathRecord) -> mi.Bool:
    """Lanes whose light vertex was sampled from the lights rather than found by a bounce."""
    return (record.info & 8) != 0


def reconnection_index(record: PathRecord) -> mi.UInt32:
    """Index k of the reconnection vertex, 0 where the path has none."""
    return (record.info >> 4) & MAX_EDGES


def edge_count(record: PathRecord) -> mi.UInt32:
    """Number of edges d, the depth in Mitsuba's sense (1 is directly visible emission)."""
    return (record.info >> 16) & MAX_EDGES


def next_kind_of(record: PathRecord) -> mi.UInt32:
    """Kind of a ``FAR`` path as seen from x_{k+1}: ``FAR``, ``NEE`` or ``HIT``.

    ``EMPTY`` where x_{k+1} scatters by a delta lobe, so that the direction leaving it is not free.
    """
    return record.info >> 28


def rounding(stream: Stream, info: mi.UInt32, following: bool) -> tuple[mi.UInt32, mi.UInt32]:
    """The words by which a path's radiance is rounded, or that of its continuation.

    They are primary samples of the path like all others, the same whenever it is traced again.

    Parameters
    ----------
    info : UInt32
        As packed in the record; no two paths of a stream have the same end.
    """
    end = info & (8 | MAX_EDGES << 16)
    return stream.words((end >> 15) | ((end >> 3) & 1) | (following << 13), ROUNDING)


def with_factor(path: PathRecord, factor: mi.Float) -> PathRecord:
    """The path as seen from the pixel it was shifted to: the same record, its own p G p."""
    return replace(path, factor=factor)


def continuation_of(record: PathRecord) -> Continuation:
    """The record's continuation, which mutations rely on."""
    assert isinstance(record.next, Continuation)
    return record.next
