"""Counter-based random numbers: u = hash(name, vertex, dimension), without any state to keep.

A stream is named by three words and draws its numbers by ``(vertex, block)``. Nothing is consumed
in order, so a replay may skip a number without shifting those that follow. The generator is
Mitsuba's TEA hash (Zafar, Olano and Curtis 2010): two 32-bit words per call.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from .absent import Absent
from .codes import Codes

LOBE, DIRECTION, LIGHT = 0, 1, 2
"""Blocks of two numbers that a path vertex owns: (lobe, roulette), direction, light sample."""

WAVELENGTH = 3
"""Block of vertex 0 that holds the wavelength sample of spectral variants."""

ROUNDING = 3
"""The same block of other vertices: how what a record keeps of a path is rounded."""

_BLOCKS = 4
_ROUNDS = 4


class Purpose(Codes):
    """What a pass draws numbers for: two purposes never read the same numbers, nor do paths."""

    PATHS = 0  # the paths' own
    PRIMARY = 1  # sub-pixel positions, lens points, time
    INITIAL = 2  # which candidate stays
    TEMPORAL = 3  # whether the history's path replaces it
    SPATIAL = 4  # which neighbour's path replaces it
    NEIGHBORS = 5  # who the neighbours are
    MUTATION = 6  # proposals and their acceptance
    SELECTION = 7  # the order in which pixels choose what they show
    ORDER = 8  # the order in which pixels are mutated


@dataclass
class Stream:
    """State of a counter-based stream: two hashed words per lane."""

    x: mi.UInt32
    y: mi.UInt32

    def words(self, vertex: mi.UInt32 | int, block: int) -> tuple[mi.UInt32, mi.UInt32]:
        """The two 32-bit words of one block of one vertex (see :func:`uniform2`)."""
        counter = mi.UInt32(vertex) * _BLOCKS + block
        # The odd multiplier (2^32 / golden ratio) spreads neighbouring counters over the word.
        return mi.sample_tea_32(self.x + counter * 0x9E3779B9, self.y, _ROUNDS)

    def fork(self, n: mi.UInt32 | int) -> Stream:
        """The ``n``-th stream of a family of its own, n < 2^32 - 1.

        The hash is a permutation of the two words, and the second one differs from the stream's:
        no two forks of a stream are equal, nor is any equal to what the stream itself draws.
        """
        return Stream(*mi.sample_tea_32(self.x, self.y + (mi.UInt32(n) + 1), _ROUNDS))


@dataclass
class PathName:
    """What names a path's stream, as its record stores it.

    Fields: ``pixel`` (source pixel, as the grid counts them), ``sample`` (running number of
    the path tree), ``seed`` (the user's; where it is absent, ``sample`` is :func:`moved` by it).
    """

    pixel: mi.UInt32
    sample: mi.UInt32
    seed: mi.UInt32 | Absent

    def stream(self) -> Stream:
        """The path's primary samples."""
        name = self.short()
        x, y = mi.sample_tea_32(mi.UInt32(name.pixel), mi.UInt32(name.sample), _ROUNDS)
        return Stream(*mi.sample_tea_32(x, y, _ROUNDS))

    def short(self) -> PathName:
        """The same stream's name without a seed."""
        if isinstance(self.seed, Absent):
            return self
        return PathName(self.pixel, moved(self.sample, self.seed), Absent())


def moved(sample: mi.UInt32, seed: mi.UInt32) -> mi.UInt32:
    """Where a running number is among those of all seeds, which begin at random places.

    Within a seed no two are the same; runs of n trees with two seeds overlap with a probability of
    n / 2^31.
    """
    return sample + mi.sample_tea_32(mi.UInt32(seed), mi.UInt32(0x2545F491), 2 * _ROUNDS)[0]


@dataclass
class FrameKey:
    """What names a frame: running number of its first sample, and the user's seed (opaque)."""

    sample: mi.UInt32
    seed: mi.UInt32

    def stream(self, purpose: int, pixel: mi.UInt32 | int) -> Stream:
        """Stream for the choices that a pass makes, disjoint from all paths.

        Parameters
        ----------
        purpose : int
            A member of :class:`Purpose`.
        pixel : UInt32 or int
            Whose choices; one number for choices that all pixels share.
        """
        word = mi.UInt32(self.seed) ^ mi.UInt32(0x632BE5AB)
        x, y = mi.sample_tea_32(word, mi.UInt32(purpose), _ROUNDS)
        return PathName(mi.UInt32(pixel) ^ x, mi.UInt32(self.sample) + y, x).stream()


def uniform2(stream: Stream, vertex: mi.UInt32 | int, block: int) -> tuple[mi.Float, mi.Float]:
    """Two independent uniform numbers in [0, 1) for one block of one vertex.

    Parameters
    ----------
    vertex : UInt32 or int
        Index of the path vertex (1 is the primary hit), or a counter of the pass.
    block : int
        One of the module's block constants.
    """
    a, b = stream.words(vertex, block)
    return to_unit(a), to_unit(b)


def uniform(stream: Stream, vertex: mi.UInt32 | int, block: int) -> mi.Float:
    """One uniform number in (0, 1) that resolves 2^-48, for a decision with a tiny probability.

    A number on a grid of 2^-24 would accept whatever is possible at all with a probability of at
    least 2^-24, and a path chosen far too often carries a weight that is far too large.
    """
    a, b = uniform2(stream, vertex, block)
    # The largest sum rounds to 1, and what is certain would then not be accepted.
    return dr.minimum(a + (b + 2.0**-25) * 2.0**-24, 1 - 2.0**-24)


def to_unit(word: mi.UInt32) -> mi.Float:
    """Upper 24 bits of a word as a float in [0, 1): every value is exact in single precision."""
    return mi.Float(word >> 8) * 2.0**-24
