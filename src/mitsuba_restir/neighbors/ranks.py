"""Groups of pixels exchange paths by rank: mask against luminance.

A random choice of neighbours is white noise. Here a blue-noise mask makes it. The pixels of a group
(:mod:`.groups`) fall into classes of like surfaces. A class of N pixels has two orders: by the
luminance of F W, and by the mask, whose ranks are then turned by an offset that is uniform on
0 ... N - 1. With k neighbours there are kN edges, and edge h joins

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
from ..sampling.streams import Stream
from .groups import COMMON, NOWHERE, TURN, Groups, members

TOGETHER = 3
"""Members whose ranks are counted at once: what is read serves them all, in half the time."""

# Counts of other members share a word, a byte each: groups have at most 256 members.
_ALIKE, _LOWER, _BELOW = 1 << 8, 1 << 16, 1 << 24


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
    dr.eval(pixel, label, entries)
    size = groups.cells**2
    step = -(-size // TOGETHER)
    lane = dr.arange(mi.UInt32, dr.width(pixel) // size * step)
    begin = lane // step * size
    places = [lane % step + i * step for i in range(TOGETHER)]
    lanes = [begin + dr.minimum(place, size - 1) for place in places]
    ranks = _no_ranks(grid.size, dr.width(pixel))
    for place, own, counts in zip(places, lanes, _count(begin, lanes, size, entries), strict=True):
        before, count, value_rank, mask_rank, total = counts
        first, mask_rank = begin + before, turned(mask_rank, count, choices)
        target = dr.gather(mi.UInt32, pixel, own)
        used = (place < size) & (dr.gather(mi.UInt32, label, own) != NOWHERE)
        for result, entry, index in (
            (ranks.first, first, target),
            (ranks.count, count, target),
            (ranks.value, value_rank, target),
            (ranks.mask, mask_rank, target),
            (ranks.confidence, total, target),
            (ranks.by_value, target, first + value_rank),
            (ranks.by_mask, target, first + mask_rank),
        ):
            # No two members have one index: said so, one kernel writes them all.
            dr.scatter(result, entry, index, used, mode=dr.ReduceMode.NoConflicts)
    return ranks


def _no_ranks(pixels: int, entries: int) -> Ranks:
    """Of as many pixels, with tables of as many entries, to be filled."""
    first, count, value, mask = (dr.zeros(mi.UInt32, pixels) for _ in range(4))
    by_value, by_mask = (dr.zeros(mi.UInt32, entries) for _ in range(2))
    return Ranks(first, count, value, mask, dr.zeros(mi.Float, pixels), by_value, by_mask)


def turned(rank: mi.UInt32, count: mi.UInt32, choices: Stream) -> mi.UInt32:
    """Turn the ranks 0 ... ``count`` - 1 by a random offset, the same for all groups, and fold."""
    word, _ = choices.words(TURN, COMMON)
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
    # Less one that is alike, as each meets itself: 256 would not fit into a byte.
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
        before, others, value_rank, mask_rank = (word >> shift & 0xFF for shift in (0, 8, 16, 24))
        found.append((before, others + 1, value_rank, mask_rank, total))
    return found
