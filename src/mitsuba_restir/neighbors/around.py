"""The 20 pixels around each pixel, as far as they are in the image and alike; sets out of reach."""

from __future__ import annotations

from typing import Any, TypeVar

import drjit as dr
import mitsuba as mi

from ..paths.grid import Grid
from ..paths.primary_hit import PrimaryHit
from .similarity import similar

Values = TypeVar("Values")

REACH = 2
"""Columns and rows on each side."""

OFFSETS = [
    (x, y)
    for y in range(-REACH, REACH + 1)
    for x in range(-REACH, REACH + 1)
    if 0 < x**2 + y**2 < 2 * REACH**2
]
"""(columns, rows) from a pixel to each of its neighbours: 5x5 without centre and corners."""

ADJACENT = sum(1 << i for i, (x, y) in enumerate(OFFSETS) if max(abs(x), abs(y)) == 1)
"""Bits of the eight neighbours next to it."""


def spaced_pixels(grid: Grid, spacing: int, number: mi.UInt32) -> tuple[mi.UInt32, mi.Bool]:
    """Every n-th pixel of every n-th row.

    Parameters
    ----------
    spacing : int
        The distance n.
    number : UInt32
        Which set of pixels, below ``spacing**2``.

    Returns
    -------
    pixel : UInt32
        Index in the grid.
    inside : Bool
        Whether it lies in the image.
    """
    lanes = -(-grid.columns // spacing) * -(-grid.rows // spacing)
    columns = (grid.width + (spacing - 1)) // spacing
    lane = dr.arange(mi.UInt32, lanes)
    row = lane // columns
    x = (lane - row * columns) * spacing + number % spacing
    y = row * spacing + number // spacing
    return grid.index(x, y), (x < grid.width) & (y < grid.height)


def similar_neighbors(grid: Grid, hits: PrimaryHit, step: int = 1) -> mi.UInt32:
    """Which neighbours of every pixel count.

    Parameters
    ----------
    hits : PrimaryHit
        Of all pixels.
    step : int
        Factor of the offsets.

    Returns
    -------
    UInt32
        Bit i: the neighbour at ``OFFSETS[i]`` is in the image and similar in the G-buffer.
    """
    pixel = grid.pixels()
    bits = mi.UInt32(0)
    for i, (dx, dy) in enumerate(OFFSETS):
        other, inside = grid.look(pixel, step * dx, step * dy)
        alike = inside & similar(hits, hits.at(other, inside))
        bits |= dr.select(alike, mi.UInt32(1 << i), 0)
    return bits


def counts(alike: mi.UInt32, neighbor: int) -> mi.Bool:
    """Whether the neighbour of this number counts, by the bits of :func:`similar_neighbors`."""
    return (alike & (1 << neighbor)) != 0


def local_mean(grid: Grid, values: Values, alike: mi.UInt32, step: int = 1) -> Values:
    """Mean over every pixel and the neighbours that count.

    Parameters
    ----------
    values : Float or Color3f
        Of all pixels.
    alike : UInt32
        Result of :func:`similar_neighbors` with the same ``step``.
    """
    dr.eval(values)
    kind: Any = type(values)
    pixel = grid.pixels()
    total, number = kind(values), mi.Float(1)
    for i, (dx, dy) in enumerate(OFFSETS):
        active = counts(alike, i)
        total += dr.gather(kind, values, grid.beside(pixel, (step * dx, step * dy)), active)
        number += dr.select(active, mi.Float(1), 0)
    return total / number
