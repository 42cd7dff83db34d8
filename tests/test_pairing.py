"""Reciprocal neighbours: every partner's partner is the pixel itself, and blocks stay together."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from mitsuba_restir.paths.grid import BAND, grid_of
from mitsuba_restir.sampling.pairing import (
    BLOCK,
    block_offsets,
    block_side,
    pairing_tile,
    partner_offset,
)
from mitsuba_restir.sampling.streams import FrameKey, Purpose

pytestmark = pytest.mark.usefixtures("rgb")

RADII = [1.0, 1.8, 3.0, 5.0, 8.4, 14.0, 20.0]


def places(size: int) -> tuple[np.ndarray, np.ndarray]:
    y, x = np.indices((size, size))
    return x, y


@pytest.mark.parametrize("radius", RADII)
def test_partners_are_mutual_and_within_the_radius(radius: float) -> None:
    offsets = block_offsets(radius, 128)
    x, y = places(128)
    there = (y + offsets[..., 1]) % 128, (x + offsets[..., 0]) % 128
    assert np.array_equal(offsets[there], -offsets)
    side = block_side(radius)
    # A block's centre is rounded to a block, and its pixels are up to a block's side apart.
    slack = np.sqrt(2) * (side / 2 + side - 1)
    assert np.hypot(*np.moveaxis(offsets, -1, 0)).max() <= radius + slack
    assert np.mean(np.any(offsets != 0, axis=-1)) > 0.9


@pytest.mark.parametrize("radius", [5.0, 14.0, 20.0])
def test_a_block_has_one_block_of_partners(radius: float) -> None:
    side = block_side(radius)
    assert side > 1
    offsets = block_offsets(radius, 128)
    x, y = places(128)
    partner = (y + offsets[..., 1]) % 128 // side * 128 + (x + offsets[..., 0]) % 128 // side
    blocks = partner.reshape(128 // side, side, 128 // side, side)
    assert np.all(blocks == blocks[:, :1, :, :1])


def test_partners_are_spread_like_a_disk() -> None:
    """Root mean square of the distance: radius / sqrt(2), and a little for what is rounded."""
    for radius in (14.0, 20.0, 30.0):
        offsets = block_offsets(radius, 256)
        spread = np.sqrt(np.mean(np.sum(offsets**2, axis=-1)))
        assert 0.98 < spread / (radius / np.sqrt(2)) < 1.08


def test_blocks_are_lines_of_the_grid() -> None:
    """What makes them worth it: the partners of a line of the processor's cache are one line."""
    assert BLOCK == BAND
    grid, tile = grid_of(96, 64), pairing_tile(20.0)
    pixel = grid.pixels()
    for frame in range(4):
        key = FrameKey(mi.UInt32(frame), mi.UInt32(7))
        choices = key.stream(Purpose.NEIGHBORS, mi.UInt32(0))
        offset = partner_offset(tile, choices, mi.UInt32(0), *grid.place(pixel))
        other, inside = grid.look(pixel, *offset)
        line = np.where(np.array(inside), np.array(other) // BLOCK**2, -1).reshape(-1, BLOCK**2)
        assert np.all(line == line[:, :1])
        back = dr.gather(mi.UInt32, other, other)
        assert np.array_equal(np.array(back), np.array(pixel))
