"""The pixel grid: where the pixel of an index is, and the index of the pixel at a place."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi


@dataclass
class Grid:
    """The pixels of a crop window, row-major.

    Fields: ``columns``, ``rows`` (int), and the same as ``width``, ``height`` (opaque, so that a
    kernel fits all sizes).
    """

    columns: int
    rows: int
    width: mi.UInt32
    height: mi.UInt32

    @property
    def size(self) -> int:
        """Number of pixels."""
        return self.columns * self.rows

    def pixels(self) -> mi.UInt32:
        """Index of every pixel."""
        return dr.arange(mi.UInt32, self.size)

    def place(self, pixel: mi.UInt32) -> tuple[mi.UInt32, mi.UInt32]:
        """Column and row of a pixel."""
        y = pixel // self.width
        return pixel - y * self.width, y

    def index(self, x: mi.UInt32, y: mi.UInt32) -> mi.UInt32:
        """Index of the pixel in column ``x`` and row ``y``, which must be in the window."""
        return mi.UInt32(y * self.width + x)

    def contains(self, x: mi.Int32, y: mi.Int32) -> mi.Bool:
        """Whether a place is in the window."""
        inside = (x >= 0) & (x < mi.Int32(self.width))
        return inside & (y >= 0) & (y < mi.Int32(self.height))

    def beside(self, pixel: mi.UInt32, offset: tuple[int, int]) -> mi.UInt32:
        """Index of the pixel at an offset (columns, rows); it must be in the window."""
        return mi.UInt32(mi.Int32(pixel) + offset[1] * mi.Int32(self.width) + offset[0])

    def look(
        self, pixel: mi.UInt32, dx: mi.Int32 | int, dy: mi.Int32 | int
    ) -> tuple[mi.UInt32, mi.Bool]:
        """Index of the pixel at an offset (the pixel itself outside), and whether it is inside."""
        x, y = self.place(pixel)
        there, below = mi.Int32(x) + dx, mi.Int32(y) + dy
        inside = self.contains(there, below)
        return dr.select(inside, mi.UInt32(below * mi.Int32(self.width) + there), pixel), inside


def grid_of(columns: int, rows: int) -> Grid:
    """The grid of a window of a size in pixels."""
    return Grid(columns, rows, dr.opaque(mi.UInt32, columns), dr.opaque(mi.UInt32, rows))
