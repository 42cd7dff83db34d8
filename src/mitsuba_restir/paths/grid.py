"""The pixel grid: where the pixel of an index is, and the index of the pixel at a place.

Pixels are stored in bands of rows, and within a band column by column, so that what lies around a
pixel fits a processor's cache however wide the image is. Only this module knows of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt

from .divisor import Divisor, divisor

BAND = 4
"""Rows of a band, but for the last one: the values of a block of 4 x 4 pixels are then a line of a
processor's cache."""


@dataclass
class Grid:
    """The pixels of a crop window.

    Fields: ``columns``, ``rows`` (int), and what kernels divide by: ``width``, ``band`` (pixels of
    a band) and ``last`` (rows of the last band), with ``height`` and ``bottom`` (where the last
    band begins), all opaque, so that a kernel fits all sizes.
    """

    columns: int
    rows: int
    width: mi.UInt32
    height: mi.UInt32
    bottom: mi.UInt32
    band: Divisor
    last: Divisor

    @property
    def size(self) -> int:
        """Number of pixels."""
        return self.columns * self.rows

    def pixels(self) -> mi.UInt32:
        """Index of every pixel."""
        return dr.arange(mi.UInt32, self.size)

    def by_rows(self) -> mi.UInt32:
        """Index of every pixel, row by row: gathered by it, an array is an image."""
        lane = self.pixels()
        y = lane // self.width
        return self.index(lane - y * self.width, y)

    def by_pixels(self) -> mi.UInt32:
        """Place of every pixel, row by row: gathered by it, an image is an array."""
        x, y = self.place(self.pixels())
        return y * self.width + x

    def image(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Values of every pixel, (..., pixels), as an image on the host, (..., rows, columns)."""
        ordered = values[..., np.array(self.by_rows())]
        return ordered.reshape(*values.shape[:-1], self.rows, self.columns)

    def place(self, pixel: mi.UInt32) -> tuple[mi.UInt32, mi.UInt32]:
        """Column and row of a pixel."""
        band, within = self.band.divmod(pixel)
        top = band * BAND
        x, y = self.last.divmod(within)
        whole = top < self.bottom
        x, y = dr.select(whole, within // BAND, x), dr.select(whole, within % BAND, y)
        return x, top + y

    def index(self, x: mi.UInt32, y: mi.UInt32) -> mi.UInt32:
        """Index of the pixel in column ``x`` and row ``y``, which must be in the window."""
        top = y // BAND * BAND
        high = dr.select(top < self.bottom, BAND, self.last.number)
        return top * self.width + x * high + (y - top)

    def contains(self, x: mi.Int32, y: mi.Int32) -> mi.Bool:
        """Whether a place is in the window."""
        inside = (x >= 0) & (x < mi.Int32(self.width))
        return inside & (y >= 0) & (y < mi.Int32(self.height))

    def look(
        self, pixel: mi.UInt32, dx: mi.Int32 | int, dy: mi.Int32 | int
    ) -> tuple[mi.UInt32, mi.Bool]:
        """Index of the pixel at an offset (the pixel itself outside), and whether it is inside."""
        x, y = self.place(pixel)
        there, below = mi.Int32(x) + dx, mi.Int32(y) + dy
        inside = self.contains(there, below)
        return dr.select(inside, self.index(mi.UInt32(there), mi.UInt32(below)), pixel), inside

    def beside(self, pixel: mi.UInt32, offset: tuple[int, int]) -> mi.UInt32:
        """Index of the pixel at an offset (columns, rows), which must be in the window."""
        (x, y), (dx, dy) = self.place(pixel), offset
        return self.index(mi.UInt32(mi.Int32(x) + dx), mi.UInt32(mi.Int32(y) + dy))


def grid_of(columns: int, rows: int) -> Grid:
    """The grid of a window of a size in pixels."""
    bottom = (rows - 1) // BAND * BAND
    width, height, begin = (dr.opaque(mi.UInt32, value) for value in (columns, rows, bottom))
    band, last = divisor(BAND * columns), divisor(rows - bottom)
    return Grid(columns, rows, width, height, begin, band, last)
