"""Dithered primary samples: a path's first dimensions from a blue-noise mask, the rest hashed.

Dimension d of sample t at pixel p is

    u_d = frac(B[(p + o_d) mod n] + alpha_d t)

(Georgiev and Fajardo 2016: a Cranley-Patterson rotation of one point sequence by a mask). B holds
each rank once, plus jitter within the rank's cell, and the toroidal offset o_d is hashed from the
seed: over seeds every u_d is uniform and all are independent, whatever the mask. Sums over
candidates are linear, so that resampling stays unbiased although pixels depend on each other.

Everything is computed in 32-bit integers, whose overflow is the fractional part: no precision is
lost at large t, and a replay repeats every bit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt

from .absent import Absent
from .streams import DIRECTION, LIGHT, LOBE, PathName, Stream

_ROUNDS = 4
_OFFSETS = 0x5851F42D  # keeps the offsets' hashes apart from those of paths and passes

# Of each dithered block of a vertex: its first dimension, and how many of its two numbers are
# dithered. The second number of LOBE decides the roulette and stays hashed.
_DIMENSIONS = {LOBE: (0, 1), DIRECTION: (1, 2), LIGHT: (3, 2)}

MAX_VERTICES = 2
"""Most vertices whose samples can be dithered, from the primary hit on."""

# Richtmyer's sequence: alpha = frac(sqrt(prime)), here in units of 2^-32. Which primes matters: by
# 3 and 5 the two numbers of a direction nearly sum to a constant, and 20 frames are no better than
# white noise. These were searched among the primes below 230 for the variance of the mean of 8, 20
# and 64 samples of discs, lobes and half-planes: mostly in the pairs of a direction and of a light
# sample (0.11 of the variance of independent samples), then in all pairs that one path uses.
_PRIMES = (2, 53, 193, 113, 173, 73, 5, 19, 97, 179)
_ALPHAS = tuple(math.isqrt(prime << 64) & 0xFFFFFFFF for prime in _PRIMES)


@dataclass
class MaskTexture:
    """A square mask on the device.

    Attributes
    ----------
    levels : UInt32
        Ranks as 32-bit fractions, rank * 2^32 / n², row-major.
    bits : int
        log2 of the side n.
    """

    levels: mi.UInt32
    bits: int

    def level(self, x: mi.UInt32, y: mi.UInt32, key: mi.UInt32) -> mi.UInt32:
        """Level (``UInt32``) at pixel (x, y), moved by a toroidal offset: 16 bits of ``key`` each.

        Parameters
        ----------
        x, y : UInt32
            Column and row in the image.
        key : UInt32
            Uniform random word; equal for all pixels, or the mask's spectrum is lost.
        """
        inside = (1 << self.bits) - 1
        column = (mi.UInt32(x) + (key & 0xFFFF)) & inside
        row = (mi.UInt32(y) + (key >> 16)) & inside
        return dr.gather(mi.UInt32, self.levels, (row << self.bits) | column)


def mask_texture(ranks: npt.ArrayLike) -> MaskTexture:
    """Put a mask onto the device.

    Parameters
    ----------
    ranks : array_like of int, (n, n)
        Each rank from 0 to n² - 1 once; n a power of two, at most 4096.
    """
    r = np.asarray(ranks)
    bits = len(r).bit_length() - 1
    if r.shape != (1 << bits, 1 << bits) or bits > 12:
        raise ValueError(
            f"A mask for dithering is square with a side that is a power of two up to 4096, "
            f"not of shape {r.shape}."
        )
    levels = r.astype(np.uint32) << np.uint32(32 - 2 * bits)
    return MaskTexture(mi.UInt32(levels.ravel()), bits)


@dataclass
class DitheredStream(Stream):
    """A stream whose first dimensions are dithered.

    Fields: ``dithered`` holds, for each dithered vertex, a tuple with the words (``UInt32``) of its
    dimensions without jitter; ``cell_bits`` (int) is the log2 of the number of cells.
    """

    dithered: tuple[tuple[mi.UInt32, ...], ...]
    cell_bits: int

    def words(self, vertex: mi.UInt32 | int, block: int) -> tuple[mi.UInt32, mi.UInt32]:
        """The two 32-bit words of one block of one vertex (see ``streams.uniform2``)."""
        hashed = super().words(vertex, block)
        result = list(hashed)
        first, count = _DIMENSIONS.get(block, (0, 0))
        for number, dimensions in enumerate(self.dithered, start=1):
            here = mi.UInt32(vertex) == number
            for i in range(count):
                word = dimensions[first + i] + (hashed[i] >> self.cell_bits)
                result[i] = dr.select(here, word, result[i])
        return result[0], result[1]


@dataclass
class Dither:
    """What turns a hashed stream into a dithered one; the same for all frames of a history.

    Attributes
    ----------
    mask : MaskTexture
        Blue noise, or white noise for comparison.
    vertices : int
        How many vertices are dithered, from the primary hit on: 1 or 2.
    """

    mask: MaskTexture
    vertices: int = 1

    def __post_init__(self) -> None:
        if not 1 <= self.vertices <= MAX_VERTICES:
            raise ValueError(
                f"The number of dithered vertices is 1 to {MAX_VERTICES}, not {self.vertices}."
            )

    def stream(self, name: PathName, x: mi.UInt32, y: mi.UInt32) -> DitheredStream:
        """Dither the stream of the path ``name``, whose source pixel is in column x and row y.

        The mask is read here, once per path and not in the loop over its vertices, which can only
        hold arrays of one entry per path.
        """
        assert not isinstance(name.seed, Absent)
        hashed, sample, seed = name.stream(), mi.UInt32(name.sample), mi.UInt32(name.seed)
        alphas = iter(_ALPHAS)
        dithered = []
        for vertex in range(1, self.vertices + 1):
            words = []
            for block, (_, count) in _DIMENSIONS.items():
                keys = mi.sample_tea_32(
                    seed ^ mi.UInt32(_OFFSETS), mi.UInt32(vertex << 8 | block), _ROUNDS
                )
                for key in keys[:count]:
                    words.append(self.mask.level(x, y, key) + sample * next(alphas))
            dithered.append(tuple(words))
        cell_bits = 2 * self.mask.bits
        return DitheredStream(hashed.x, hashed.y, tuple(dithered), cell_bits)
