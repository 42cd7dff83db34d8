"""Cells of space, by which is kept what earlier frames have found.

Cells are cubes of a world grid, told apart by the main direction of the surface as well, and hashed
into tables of fixed size without a checksum: cells that collide share what is known, which costs
variance and no bias.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

CELLS = 1 << 12
"""Entries of a table."""

GRID = 24
"""Cells along the longest side of the scene."""

UNIT = 2.0**-16
"""What a frame is counted in: integers, whose sums do not depend on the order of threads. Relative
to the largest value that counts, or to a mean."""


@dataclass
class Cells:
    """Where the cells of a scene are.

    Fields: ``corner`` (of the grid, world), ``scale`` (cells per unit of length).
    """

    corner: mi.Point3f
    scale: mi.Float


def cells_of(scene: mi.Scene) -> Cells:
    """The cells for the extent of a scene."""
    box = scene.bbox()
    extent = max(*(float(side) for side in box.extents()), 1e-20)
    return Cells(mi.Point3f(box.min), mi.Float(GRID / extent))


def cell_at(cells: Cells, p: mi.Point3f, n: mi.Normal3f) -> mi.UInt32:
    """The cell of a surface point.

    Parameters
    ----------
    p, n : Point3f, Normal3f
        A surface point and its normal.
    """
    place = (p - cells.corner) * cells.scale
    key = mi.Vector3u(mi.Vector3i(dr.floor(place)))
    size = dr.abs(n)
    largest = dr.max(size)
    axis = dr.select(size.x == largest, mi.UInt32(0), dr.select(size.y == largest, 2, 4))
    along = dr.select(size.x == largest, n.x, dr.select(size.y == largest, n.y, n.z))
    facing = axis + dr.select(along < 0, mi.UInt32(1), 0)
    a, _ = mi.sample_tea_32(key.x ^ (key.y << 11), key.z ^ (facing << 28))
    return a & (CELLS - 1)
