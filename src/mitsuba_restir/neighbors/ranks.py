"""Groups of scattered pixels that exchange paths by rank: mask against luminance.

A random choice of neighbours is white noise. Here a blue-noise mask makes it. Anew in every frame
and round, the image is cut into blocks of n x n cells at a random offset, and a group takes one
random pixel of every cell; its pixels fall into classes of like surfaces. A class of N pixels has
two orders: by the luminance of F W, and by the mask, whose ranks are then turned by an offset that
is uniform on 0 ... N - 1. With k neighbours there are kN edges, and edge h joins

    the taker, the pixel of mask rank h mod N,    and the source, the path of rank floor(h / k).

A pixel of mask rank r so takes the ranks floor((jN + r) / k), j < k: one from each of k strata, in
the same direction in all, so that the mean of its picks follows the mask; and every path is taken k
times (a histogram as in Salaun et al. 2025, without blocks in the image).

The turn alone makes it unbiased: given all paths, each pixel of the class is the taker (and the
source) of each path with expectation k/N, whatever the mask is. Turning the ranks would tear the
mask where the largest rank meets the smallest; they are folded afterwards (0, 2, 4, ..., 3, 1), so
that ranks that meet on the circle are also alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..paths.grid import Grid
from ..paths.primary_hit import PrimaryHit
from ..paths.vertex import exists
from ..sampling.dither import MaskTexture
from ..sampling.streams import Stream, uniform2

SLAB = 0.5
"""Thickness of the slabs of space that tell surfaces apart, at most, relative to their distance."""

NOWHERE = 0xFFFFFFFF
"""Label of pixels that see no surface, and of places outside the image."""

CELLS = 8
"""Cells along a block's side, if pixels allow it."""

SPREAD = 1.35
"""Side of a block relative to the radius of reuse. In the mean square, two random points of a block
are then 1.1 times as far apart as the centre and a random point of a disk with the radius."""

TOGETHER = 3
"""Members whose ranks are counted at once: what is read serves them all, in half the time."""

# Counts of other members share a word, a byte each: groups have at most 256 members.
_ALIKE, _LOWER, _BELOW = 1 << 8, 1 << 16, 1 << 24

# Blocks of the round's stream; its vertices number the blocks' cells, or the purposes below.
_CELLS, _COMMON = 2, 3
_OFFSET, _TURN, _MASK, _SLABS = range(4)


@dataclass
class Groups:
    """How pixels are grouped.

    Attributes
    ----------
    mask : MaskTexture
        Whose ranks decide.
    cells : int
        Cells along a side of a block, n; at most 16.
    side : int
        Side of a cell [pixels].
    """

    mask: MaskTexture
    cells: int
    side: int


@dataclass
class Members:
    """The groups' pixels, group after group, one lane each.

    Fields: ``pixel`` (in the grid; 0 outside), ``inside`` (lies in the image), ``level`` (of the
    mask).
    """

    pixel: mi.UInt32
    inside: mi.Bool
    level: mi.UInt32


@dataclass
class Ranks:
    """Every pixel's ranks in its class.

    Fields: ``first`` (where the class begins in the tables), ``count`` (N; 0 for pixels without a
    surface), ``value``, ``mask`` (the two ranks), ``confidence`` (sum over the class),
    ``by_value``, ``by_mask`` (tables: the pixel of each rank).
    """

    first: mi.UInt32
    count: mi.UInt32
    value: mi.UInt32
    mask: mi.UInt32
    confidence: mi.Float
    by_value: mi.UInt32
    by_mask: mi.UInt32

    def source(self, j: mi.UInt32, neighbors: int) -> mi.UInt32:
        """The pixel whose path every pixel takes as its ``j``-th neighbour's."""
        rank = (j * self.count + self.mask) // neighbors
        return dr.gather(mi.UInt32, self.by_value, self.first + rank, self.count > 0)

    def taker(self, t: int, neighbors: int) -> tuple[mi.UInt32, mi.UInt32]:
        """The ``t``-th pixel that takes every pixel's path, and as the path of which neighbour."""
        edge = self.value * neighbors + t
        j = edge // dr.maximum(self.count, 1)
        rank = edge - j * self.count
        return dr.gather(mi.UInt32, self.by_mask, self.first + rank, self.count > 0), j


def scattered_groups(mask: MaskTexture, radius: float) -> Groups:
    """Groups in which two pixels are about as far apart as a disk's random point from its centre.

    Parameters
    ----------
    radius : float
        Of the disk [pixels].
    """
    side = max(1, round(SPREAD * radius / CELLS))
    return Groups(mask, max(2, round(SPREAD * radius / side)), side)


def surface_labels(hits: PrimaryHit, choices: Stream) -> mi.UInt32:
    """Labels that like surfaces share: the same main direction and slab of space.

    Parameters
    ----------
    choices : Stream
        Moves the slabs' limits, so that no surface is cut for ever.
    """
    direction = dr.round(hits.normal)
    span = hits.vertex.p - hits.origin
    a, b = uniform2(choices, _SLABS, _COMMON)
    octave = dr.floor(dr.log2(dr.norm(span)) + a)
    thickness = SLAB * dr.exp2(octave - a)
    slab = dr.floor(dr.dot(dr.normalize(direction), span) / thickness + b)
    facing = mi.UInt32(direction.x + 3 * direction.y + 9 * direction.z + 13)
    label = facing | ((mi.UInt32(mi.Int32(octave)) & 0x7F) << 5) | (mi.UInt32(mi.Int32(slab)) << 12)
    return dr.select(exists(hits.vertex), label, NOWHERE)


def members(grid: Grid, groups: Groups, choices: Stream) -> Members:
    """Cut an image into groups.

    Parameters
    ----------
    choices : Stream
        The round's stream: draws the offset of the blocks, the pixel that each group has in each
        cell, and the offset of the mask.
    """
    cells, side = groups.cells, groups.side
    size, block_side, per_block = cells * cells, cells * side, side * side
    columns, rows = (-(-extent // block_side) + 1 for extent in (grid.columns, grid.rows))
    columns_opaque = dr.opaque(mi.UInt32, columns)
    lane = dr.arange(mi.UInt32, columns * rows * per_block * size)
    group, member = lane // size, lane % size
    block, inner = group // per_block, group % per_block
    row = block // columns_opaque
    column = block - row * columns_opaque
    left, top = choices.words(_OFFSET, _COMMON)
    # A random toroidal shift of each cell deals its pixels out to the groups of the block.
    dx, dy = choices.words(block * size + member, _CELLS)
    x = column * block_side + member % cells * side + (inner % side + dx) % side
    y = row * block_side + member // cells * side + (inner // side + dy) % side
    x, y = mi.Int32(x - left % block_side), mi.Int32(y - top % block_side)
    inside = grid.contains(x, y)
    key, _ = choices.words(_MASK, _COMMON)
    level = groups.mask.level(x, y, key)
    return Members(dr.select(inside, grid.index(mi.UInt32(x), mi.UInt32(y)), 0), inside, level)


def rank_pixels(
    grid: Grid,
    groups: Groups,
    labels: mi.UInt32,
    values: mi.Float,
    confidence: mi.Float,
    choices: Stream,
) -> Ranks:
    """Group the pixels of an image and rank them.

    Parameters
    ----------
    labels : UInt32
        One per pixel; pixels of a group with equal labels are a class, those with the
        label :data:`NOWHERE` are left alone. Must not depend on the paths.
    values, confidence : Float
        One per pixel.
    choices : Stream
        Of the round.
    """
    group = members(grid, groups, choices)
    pixel, inside = group.pixel, group.inside
    label = dr.select(inside, dr.gather(mi.UInt32, labels, pixel, inside), NOWHERE)
    value = dr.gather(mi.Float, values, pixel, inside)
    share = dr.gather(mi.Float, confidence, pixel, inside)
    entries = _side_by_side(label, group.level, value, share)
    dr.eval(group, label, entries)
    size = groups.cells**2
    step = -(-size // TOGETHER)
    lane = dr.arange(mi.UInt32, dr.width(pixel) // size * step)
    begin = lane // step * size
    places = [lane % step + i * step for i in range(TOGETHER)]
    lanes = [begin + dr.minimum(place, size - 1) for place in places]
    of_pixels = [dr.zeros(kind, grid.size) for kind in (*[mi.UInt32] * 4, mi.Float)]
    by_value, by_mask = (dr.zeros(mi.UInt32, dr.width(pixel)) for _ in range(2))
    for place, own, counts in zip(places, lanes, _count(begin, lanes, size, entries), strict=True):
        before, count, value_rank, mask_rank, total = counts
        first = begin + before
        mask_rank = turned(mask_rank, count, choices)
        target = dr.gather(mi.UInt32, pixel, own)
        used = (place < size) & (dr.gather(mi.UInt32, label, own) != NOWHERE)
        tables = [(by_value, target, first + value_rank), (by_mask, target, first + mask_rank)]
        found = (first, count, value_rank, mask_rank, total)
        tables += [(result, entry, target) for result, entry in zip(of_pixels, found, strict=True)]
        for result, entry, index in tables:
            # No two members have one index: said so, one kernel writes them all.
            dr.scatter(result, entry, index, used, mode=dr.ReduceMode.NoConflicts)
    return Ranks(*of_pixels, by_value, by_mask)


def turned(rank: mi.UInt32, count: mi.UInt32, choices: Stream) -> mi.UInt32:
    """Turn the ranks 0 ... ``count`` - 1 by a random offset, the same for all groups, and fold."""
    word, _ = choices.words(_TURN, _COMMON)
    rank = rank + dr.mul_hi(word, count)
    rank = dr.select(rank < count, rank, rank - count)
    return dr.select(2 * rank < count, 2 * rank, 2 * count - 1 - 2 * rank)


def _side_by_side(
    label: mi.UInt32, level: mi.UInt32, value: mi.Float, confidence: mi.Float
) -> mi.UInt32:
    """What members are compared by, side by side: read at once, it takes half the time."""
    bits = (dr.reinterpret_array(mi.UInt32, number) for number in (value, confidence))
    return dr.ravel(mi.Vector4u(label, level, *bits))


def _read(entries: mi.UInt32, lane: mi.UInt32) -> tuple[mi.UInt32, mi.UInt32, mi.Float, mi.Float]:
    """Label, level, value and confidence of members."""
    label, level, *bits = dr.gather(mi.Vector4u, entries, lane)
    value, confidence = (dr.reinterpret_array(mi.Float, number) for number in bits)
    return label, level, value, confidence


@dr.syntax
def _count(
    begin: mi.UInt32, lanes: list[mi.UInt32], size: int, entries: mi.UInt32
) -> list[tuple[mi.UInt32, mi.UInt32, mi.UInt32, mi.UInt32, mi.Float]]:
    """What comes before members in their group, by comparing them with all others.

    Parameters
    ----------
    begin, lanes : UInt32, list of UInt32
        First member of a group, and those that are counted for.
    size : int
        Members of a group.
    entries : UInt32
        Result of :func:`_side_by_side`, of all members.

    Returns
    -------
    before, count, value_rank, mask_rank : UInt32
        Of each of ``lanes``: members with smaller labels, with the same label, and those of the
        same label with smaller values and levels; ties count by position.
    total : Float
        Confidence of the members with the same label.
    """
    labels, levels, values, _ = zip(*(_read(entries, lane) for lane in lanes), strict=True)
    counts = [mi.UInt32(2**32 - _ALIKE) for _ in lanes]
    totals = [mi.Float(0) for _ in lanes]
    i = mi.UInt32(begin)
    end = begin + size

    while dr.hint(i < end, label="Ranks"):
        label, level, value, confidence = _read(entries, i)
        for j in range(len(lanes)):
            alike = label == labels[j]
            earlier = i < lanes[j]
            lower = (value < values[j]) | ((value == values[j]) & earlier)
            below = (level < levels[j]) | ((level == levels[j]) & earlier)
            more = _ALIKE + dr.select(lower, mi.UInt32(_LOWER), 0)
            more += dr.select(below, mi.UInt32(_BELOW), 0)
            counts[j] += dr.select(alike, more, dr.select(label < labels[j], mi.UInt32(1), 0))
            totals[j] += dr.select(alike, confidence, 0)
        i += 1
    found = []
    for word, total in zip(counts, totals, strict=True):
        before, alike, lower, below = (word >> shift & 0xFF for shift in (0, 8, 16, 24))
        found.append((before, alike + 1, lower, below, total))
    return found
