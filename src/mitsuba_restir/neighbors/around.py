"""The 20 pixels around each pixel, as far as they are in the image and alike; sets out of reach."""

from __future__ import annotations

from collections.abc import Iterator

import drjit as dr
import mitsuba as mi

from ..paths.grid import Grid
from ..paths.primary_hit import PrimaryHit
from .similarity import Surface, alike, surface_of

REACH = 2
"""Columns and rows on each side."""

OFFSETS = [
    (x, y)
    for y in range(-REACH, REACH + 1)
    for x in range(-REACH, REACH + 1)
    if 0 < x**2 + y**2 < 2 * REACH**2
]
"""(columns, rows) from a pixel to each of its neighbours: 5x5 without centre and corners."""


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


def similar_neighbors(grid: Grid, hits: PrimaryHit) -> mi.UInt32:
    """Which neighbours of every pixel count.

    Parameters
    ----------
    hits : PrimaryHit
        Of all pixels.

    Returns
    -------
    UInt32
        Bit i: the neighbour at ``OFFSETS[i]`` is in the image and similar in the G-buffer.
    """
    pixel, own = grid.pixels(), surface_of(hits)
    places, normals = side_by_side(own.place, own.depth), side_by_side(own.normal, mi.Float(0))
    after = mi.UInt32(0)
    half = len(OFFSETS) // 2
    for i, (dx, dy) in enumerate(OFFSETS[half:], half):
        there, inside = grid.look(pixel, dx, dy)
        (*place, depth), (*normal, _) = (
            dr.gather(mi.Vector4f, values, there, inside) for values in (places, normals)
        )
        other = Surface(mi.Point3f(*place), mi.Normal3f(*normal), depth)
        after |= dr.select(inside & alike(own, other), mi.UInt32(1 << i), 0)
    dr.eval(after)
    # Each pair is asked once, from its earlier pixel.
    before = mi.UInt32(0)
    for i, (dx, dy) in enumerate(OFFSETS[:half]):
        other, inside = grid.look(pixel, dx, dy)
        theirs = dr.gather(mi.UInt32, after, other, inside)
        mutual = inside & counts(theirs, len(OFFSETS) - 1 - i)
        before |= dr.select(mutual, mi.UInt32(1 << i), 0)
    return before | after


def similar_further(grid: Grid, alike: mi.UInt32, step: int = 1) -> mi.UInt32:
    """Which pixels twice as far away count: similar to a similar neighbour on the way there.

    Parameters
    ----------
    alike : UInt32
        Result of :func:`similar_neighbors`, or of this function.
    step : int
        How far its neighbours are: 1, or twice what was given then.

    Returns
    -------
    UInt32
        Bit i: that at ``2 * step`` times ``OFFSETS[i]``.
    """
    pixel = grid.pixels()
    bits = mi.UInt32(0)
    for i, (dx, dy) in enumerate(OFFSETS):
        near = counts(alike, i)
        there = dr.gather(mi.UInt32, alike, grid.beside(pixel, (step * dx, step * dy)), near)
        bits |= dr.select(near, there & (1 << i), 0)
    return bits


def among(grid: Grid, alike: mi.UInt32, usable: mi.Bool) -> mi.UInt32:
    """Without the pixels that are not usable: they count for no other, and no other for them.

    Parameters
    ----------
    alike : UInt32
        Result of :func:`similar_neighbors`.
    usable : Bool
        Of all pixels.
    """
    dr.eval(usable)
    pixel = grid.pixels()
    bits = mi.UInt32(0)
    for i, offset in enumerate(OFFSETS):
        both = usable & counts(alike, i)
        both &= dr.gather(mi.Bool, usable, grid.beside(pixel, offset), both)
        bits |= dr.select(both, mi.UInt32(1 << i), 0)
    return bits


def counts(alike: mi.UInt32, neighbor: int) -> mi.Bool:
    """Whether the neighbour of this number counts, by the bits of :func:`similar_neighbors`."""
    return (alike & (1 << neighbor)) != 0


def side_by_side(color: mi.Color3f | mi.Point3f | mi.Normal3f, number: mi.Float) -> mi.Float:
    """Colours (or vectors), each with a number: what lies together is read in half the time."""
    values = dr.ravel(mi.Vector4f(color.x, color.y, color.z, number))
    dr.eval(color, number, values)
    return values


def colors_around(
    grid: Grid, values: mi.Float, pixel: mi.UInt32, alike: mi.UInt32, step: int = 1
) -> Iterator[tuple[tuple[int, int], mi.Color3f, mi.Float]]:
    """Offset, colour and number of every neighbour; zeros for those that do not count.

    Parameters
    ----------
    values : Float
        Result of :func:`side_by_side`, of all pixels.
    alike : UInt32
        Which neighbours count, of the pixels that ``pixel`` names.
    step : int
        Factor of the offsets.
    """
    for i, (dx, dy) in enumerate(OFFSETS):
        there = grid.beside(pixel, (step * dx, step * dy))
        found = dr.gather(mi.Vector4f, values, there, counts(alike, i))
        yield (dx, dy), mi.Color3f(found.x, found.y, found.z), found.w


def local_mean(grid: Grid, color: mi.Color3f, alike: mi.UInt32, step: int = 1) -> mi.Color3f:
    """Mean over every pixel and the neighbours that count.

    Parameters
    ----------
    color : Color3f
        Of all pixels.
    alike : UInt32
        Result of :func:`similar_neighbors`, or of :func:`similar_further` at ``step`` 2.
    """
    values = side_by_side(color, mi.Float(1))
    total, number = mi.Color3f(color), mi.Float(1)
    for _, theirs, one in colors_around(grid, values, grid.pixels(), alike, step):
        total += theirs
        number += one
    return total / number
