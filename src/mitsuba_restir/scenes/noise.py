"""Lattice noise from an integer hash: the same pictures on every machine and NumPy version."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .geometry import Array


def hash01(x: ArrayLike, y: ArrayLike = 0, seed: int = 0) -> Array:
    """
    Uniform numbers in [0, 1) from integer coordinates.

    The ``lowbias32`` mixer of C. Wellons ("Prospecting for hash functions", 2018), applied once
    for y and once for the seed.
    """
    h = np.asarray(x).astype(np.int64).astype(np.uint32)
    with np.errstate(over="ignore"):
        for value in (np.asarray(y).astype(np.int64).astype(np.uint32), np.uint32(seed)):
            h = h * np.uint32(0x9E3779B1) + value
            h = (h ^ (h >> np.uint32(16))) * np.uint32(0x7FEB352D)
            h = (h ^ (h >> np.uint32(15))) * np.uint32(0x846CA68B)
            h = h ^ (h >> np.uint32(16))
    return np.asarray(h / 2.0**32)


def value_noise(x: ArrayLike, y: ArrayLike, seed: int = 0, period: int | None = None) -> Array:
    """
    Smooth noise in [0, 1]; with a ``period`` it repeats along both coordinates.
    """
    px, py = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
    ix, iy = np.floor(px).astype(np.int64), np.floor(py).astype(np.int64)
    fx, fy = px - ix, py - iy
    fx, fy = (f * f * (3 - 2 * f) for f in (fx, fy))

    # Hash the lattice once: several pixels share each of its points.
    x0, y0 = int(ix.min()), int(iy.min())
    columns, rows = np.arange(x0, int(ix.max()) + 2), np.arange(y0, int(iy.max()) + 2)
    if period is not None:
        columns, rows = columns % period, rows % period
    table = hash01(columns[:, None], rows[None, :], seed).ravel()
    here = (ix - x0) * len(rows) + (iy - y0)

    def corner(dx: int, dy: int) -> Array:
        return np.asarray(table[here + (dx * len(rows) + dy)])

    low = corner(0, 0) * (1 - fx) + corner(1, 0) * fx
    high = corner(0, 1) * (1 - fx) + corner(1, 1) * fx
    return np.asarray(low * (1 - fy) + high * fy)


def fractal(
    x: ArrayLike, y: ArrayLike, octaves: int = 5, seed: int = 0, period: int | None = None
) -> Array:
    """Sum of octaves of `value_noise`, each half as large and twice as fine; in [0, 1]."""
    px, py = np.asarray(x, np.float64), np.asarray(y, np.float64)
    total: Array = np.zeros(np.broadcast(px, py).shape)
    for k in range(octaves):
        repeat = None if period is None else period * 2**k
        total = total + 0.5**k * value_noise(px * 2**k, py * 2**k, seed + k, repeat)
    return total / (2.0 - 0.5 ** (octaves - 1))
