"""The 20 pixels around each pixel, as far as they are in the image and alike; sets out of reach."""

from __future__ import annotations

import math
from typing import Any

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit
from .reuse import similar

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


def moved(pixel: Any, offset: tuple[int, int], width: Any) -> Any:
    """Row-major index of the pixel at an offset; it must be in the image."""
    return mi.UInt32(mi.Int32(pixel) + offset[1] * mi.Int32(width) + offset[0])


def set_lanes(size: tuple[int, int], spacing: int) -> int:
    """How many lanes :func:`pixels_of_set` needs in an image of this size."""
    return math.prod(-(-n // spacing) for n in size)


def pixels_of_set(
    number: Any, spacing: int, lanes: int, width: Any, height: Any
) -> tuple[Any, Any]:
    """Every n-th pixel of every n-th row.

    Parameters
    ----------
    number : UInt32
        Which set, below ``spacing**2``.
    spacing : int
        The distance n.
    lanes : int
        See :func:`set_lanes`.
    width, height : UInt32
        Size of the image.

    Returns
    -------
    pixel : UInt32
        Row-major index.
    inside : Bool
        Whether it lies in the image.
    """
    columns = (width + (spacing - 1)) // spacing
    lane = dr.arange(mi.UInt32, lanes)
    row = lane // columns
    x = (lane - row * columns) * spacing + number % spacing
    y = row * spacing + number // spacing
    return y * width + x, (x < width) & (y < height)


def similar_neighbors(hits: PrimaryHit, width: Any, height: Any, step: int = 1) -> Any:
    """Which neighbours of every pixel count.

    Parameters
    ----------
    hits : PrimaryHit
        Of all pixels, row-major.
    width, height : UInt32
        Size of the image.
    step : int
        Factor of the offsets.

    Returns
    -------
    UInt32
        Bit i: the neighbour at ``OFFSETS[i]`` is in the image and similar in the G-buffer.
    """
    pixel = dr.arange(mi.UInt32, dr.width(hits.vertex.p))
    y = pixel // width
    x = pixel - y * width
    bits = mi.UInt32(0)
    for i, (dx, dy) in enumerate(OFFSETS):
        beside, below = mi.Int32(x) + step * dx, mi.Int32(y) + step * dy
        inside = (beside >= 0) & (beside < mi.Int32(width))
        inside &= (below >= 0) & (below < mi.Int32(height))
        other = moved(pixel, (step * dx, step * dy), width)
        alike = inside & similar(hits, dr.gather(PrimaryHit, hits, other, inside))
        bits |= dr.select(alike, mi.UInt32(1 << i), 0)
    return bits


def counts(alike: Any, neighbor: int) -> Any:
    """Whether the neighbour of this number counts, by the bits of :func:`similar_neighbors`."""
    return (alike & (1 << neighbor)) != 0


def local_mean(values: Any, alike: Any, width: Any, step: int = 1) -> Any:
    """Mean over every pixel and the neighbours that count, of the same type as ``values``.

    Parameters
    ----------
    values : Float or Color3f
        Of all pixels, row-major.
    alike : UInt32
        Result of :func:`similar_neighbors` with the same ``step``.
    """
    dr.eval(values)
    kind = type(values)
    pixel = dr.arange(mi.UInt32, dr.width(values))
    total, number = kind(values), mi.Float(1)
    for i, (dx, dy) in enumerate(OFFSETS):
        active = counts(alike, i)
        total += dr.gather(kind, values, moved(pixel, (step * dx, step * dy), width), active)
        number += dr.select(active, mi.Float(1), 0)
    return total / number
