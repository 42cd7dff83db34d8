"""The pixel grid: every pixel has one place, whatever the size, and divisions are exact."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from mitsuba_restir.paths.divisor import divisor
from mitsuba_restir.paths.grid import BAND, grid_of

pytestmark = pytest.mark.usefixtures("rgb")

SIZES = [(1, 1), (1, 7), (7, 1), (3, 4), (16, 9), (37, 23), (64, 64), (320, 181), (1280, 722)]


@pytest.mark.parametrize("size", SIZES)
def test_places_and_indices_are_each_others_inverse(size: tuple[int, int]) -> None:
    grid = grid_of(*size)
    x, y = grid.place(grid.pixels())
    assert sorted(zip(np.array(y), np.array(x), strict=True)) == [
        (row, column) for row in range(size[1]) for column in range(size[0])
    ]
    assert np.array_equal(np.array(grid.index(x, y)), np.arange(size[0] * size[1]))


@pytest.mark.parametrize("size", SIZES)
def test_rows_and_pixels_are_each_others_inverse(size: tuple[int, int]) -> None:
    grid = grid_of(*size)
    there = dr.gather(mi.UInt32, grid.by_rows(), grid.by_pixels())
    assert np.array_equal(np.array(there), np.arange(size[0] * size[1]))


@pytest.mark.parametrize("size", [(5, 6), (37, 23)])
def test_a_look_beyond_the_border_stays(size: tuple[int, int]) -> None:
    grid = grid_of(*size)
    pixel = grid.pixels()
    x, y = (np.array(value, dtype=int) for value in grid.place(pixel))
    for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1), (-3, 5), (40, 40)):
        other, inside = grid.look(pixel, dx, dy)
        expected = (x + dx >= 0) & (x + dx < size[0]) & (y + dy >= 0) & (y + dy < size[1])
        assert np.array_equal(np.array(inside), expected)
        column, row = (np.array(value, dtype=int) for value in grid.place(other))
        assert np.array_equal(column, np.where(expected, x + dx, x))
        assert np.array_equal(row, np.where(expected, y + dy, y))


@pytest.mark.parametrize("size", [(1, 1), (5, 6), (37, 23)])
def test_an_image_has_its_pixels_where_they_are_seen(size: tuple[int, int]) -> None:
    grid = grid_of(*size)
    places = np.stack([np.array(value) for value in grid.place(grid.pixels())])
    y, x = np.indices(size[::-1])
    assert np.array_equal(grid.image(places), np.stack([x, y]))


def test_a_block_of_pixels_lies_together() -> None:
    grid = grid_of(64, 32)
    x, y = (np.array(value) for value in grid.place(grid.pixels()))
    block = (y // BAND * 64 + x // BAND).reshape(-1, BAND**2)
    assert np.all(block == block[:, :1])


@pytest.mark.parametrize("number", [1, 2, 3, 7, 16, 1280, 5119, 2**20 + 1, 2**31 - 1, 2**31])
def test_division_is_exact(number: int) -> None:
    largest = 2**31 - 1
    rng = np.random.default_rng(number)
    multiples = rng.integers(0, largest // number + 1, 1000) * number
    n = np.unique(np.clip([*multiples, *(multiples - 1), *(multiples + 1), largest], 0, largest))
    quotient, remainder = divisor(number).divmod(mi.UInt32(n.astype(np.uint32)))
    dr.eval(quotient, remainder)
    assert np.array_equal(np.array(quotient), n // number)
    assert np.array_equal(np.array(remainder), n % number)
