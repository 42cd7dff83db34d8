"""Counter-based random numbers: every number is a hash of its purpose, so paths can be replayed.

A path is named by ``(pixel, sample, seed)`` and draws its numbers by ``(vertex, block)``. Nothing
is consumed in order, so a replay may skip a number without shifting those that follow. The
generator is Mitsuba's TEA hash (Zafar, Olano and Curtis 2010): two 32-bit words per call.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import mitsuba as mi

if TYPE_CHECKING:
    from .dither import Dither

LOBE, DIRECTION, LIGHT = 0, 1, 2
"""Blocks of two numbers that a path vertex owns: (lobe, roulette), direction, light sample."""

WAVELENGTH = 3
"""Block of vertex 0 that holds the wavelength sample of spectral variants."""

_BLOCKS = 4
_ROUNDS = 4

# Domain separators, so that two passes never read the same numbers.
PRIMARY, INITIAL, TEMPORAL, SPATIAL, NEIGHBORS, MUTATION, SELECTION = 1, 2, 3, 4, 5, 6, 7


@dataclass
class Stream:
    """State of a counter-based stream: two hashed words per lane (``UInt32``)."""

    x: Any
    y: Any

    def words(self, vertex: Any, block: int) -> tuple[Any, Any]:
        """The two 32-bit words of one block of one vertex (see :func:`uniform2`)."""
        counter = mi.UInt32(vertex) * _BLOCKS + block
        # The odd multiplier (2^32 / golden ratio) spreads neighbouring counters over the word.
        return mi.sample_tea_32(self.x + counter * 0x9E3779B9, self.y, _ROUNDS)


def path_stream(pixel: Any, sample: Any, seed: Any, dither: Dither | None = None) -> Stream:
    """Primary-sample stream of a path.

    Parameters
    ----------
    pixel, sample, seed : UInt32
        Source pixel (row-major in the crop window), running sample number and user seed, as the
        path record stores them.
    dither : Dither, optional
        Takes the first dimensions from blue-noise masks. The same in every call that names the
        path: a replay without it repeats another path.
    """
    x, y = mi.sample_tea_32(mi.UInt32(pixel), mi.UInt32(sample), _ROUNDS)
    x, y = mi.sample_tea_32(x ^ mi.UInt32(seed), y, _ROUNDS)
    stream = Stream(x, y)
    return stream if dither is None else dither.stream(stream, pixel, sample, seed)


def pass_stream(purpose: int, pixel: Any, sample: Any, seed: Any) -> Stream:
    """Stream for the choices that a pass makes (selection, neighbours), disjoint from all paths."""
    x, y = mi.sample_tea_32(mi.UInt32(seed) ^ mi.UInt32(0x632BE5AB), mi.UInt32(purpose), _ROUNDS)
    return path_stream(mi.UInt32(pixel) ^ x, mi.UInt32(sample) + y, x)


def uniform2(stream: Stream, vertex: Any, block: int) -> tuple[Any, Any]:
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


def uniform(stream: Stream, vertex: Any, block: int) -> Any:
    """One uniform number in (0, 1) that resolves 2^-48, for a decision with a tiny probability.

    A number on a grid of 2^-24 would accept whatever is possible at all with a probability of at
    least 2^-24, and a path chosen far too often carries a weight that is far too large.
    """
    a, b = uniform2(stream, vertex, block)
    return a + (b + 2.0**-25) * 2.0**-24


def to_unit(word: Any) -> Any:
    """Upper 24 bits of a word as a float in [0, 1): every value is exact in single precision."""
    return mi.Float(word >> 8) * 2.0**-24
