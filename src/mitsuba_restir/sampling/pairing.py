"""Reciprocal neighbours: random tiles in which every pixel is paired with one other, both ways.

If p reuses q exactly when q reuses p, the shift from p to q serves both, and spatial reuse needs
half the shifts (Lin, Kettunen and Wyman 2026). A tile is made once; frames differ by a random
toroidal offset and reflection of it, so the choice of neighbours is independent of all samples.

What a pixel reads of its partner lies apart for every pixel, and a large image waits for it. So
blocks of pixels are paired as a whole, and within a pair of blocks pixels by a random reflection:
what a block reads lies together (:mod:`mitsuba_restir.paths.grid`).
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from .streams import Stream, uniform2

BLOCK = 4
"""Side of the blocks that are paired, at most [pixels]; a power of two. With less than two of them
to the radius there would be few partners to choose from, and blocks are smaller."""

_ROUNDS = 64
_SEED = 20220704


@dataclass
class PairingTile:
    """A tile of partner offsets.

    Fields: ``dx``, ``dy`` (``Int32``, size*size, row-major; (0, 0) where a pixel has no partner),
    ``size`` (``UInt32``, side length).
    """

    dx: mi.Int32
    dy: mi.Int32
    size: mi.UInt32


def pair_offsets(radius: float, size: int) -> np.ndarray:
    """Random toroidal matching with partners drawn from a disk.

    Parameters
    ----------
    radius : float
        Radius of the disk [pixels].
    size : int
        Side length of the tile, more than twice the radius.

    Returns
    -------
    ndarray of int, shape (size, size, 2)
        Offset (dx, dy) to each pixel's partner; the partner's offset is its negative.
    """
    rng = np.random.default_rng(_SEED)
    offsets = np.zeros((size * size, 2), dtype=np.int32)
    paired = np.zeros(size * size, dtype=bool)
    for _ in range(_ROUNDS):
        free = rng.permutation(np.flatnonzero(~paired))
        angle = 2 * np.pi * rng.random(free.size)
        length = radius * np.sqrt(rng.random(free.size))
        dx = np.rint(length * np.cos(angle)).astype(np.int32)
        dy = np.rint(length * np.sin(angle)).astype(np.int32)
        other = (free // size + dy) % size * size + (free % size + dx) % size
        wanted = ~paired[other] & (other != free)
        free, other, dx, dy = free[wanted], other[wanted], dx[wanted], dy[wanted]
        # A pixel may be named by several proposals, on either side; the first to name it wins.
        order = np.full(size * size, free.size)
        rank = np.arange(free.size)
        np.minimum.at(order, free, rank)
        np.minimum.at(order, other, rank)
        won = (order[free] == rank) & (order[other] == rank)
        free, other, dx, dy = free[won], other[won], dx[won], dy[won]
        offsets[free] = np.stack([dx, dy], axis=-1)
        offsets[other] = np.stack([-dx, -dy], axis=-1)
        paired[free] = paired[other] = True
    return offsets.reshape(size, size, 2)


def block_side(radius: float) -> int:
    """Side of the blocks that are paired for a reuse radius [pixels]."""
    side = 1
    while side < BLOCK and 4 * side <= radius:
        side *= 2
    return side


def block_offsets(radius: float, size: int) -> np.ndarray:
    """
    Random toroidal matching of blocks, and of the pixels in each pair of blocks.

    Parameters
    ----------
    radius : float
        Radius of the disk that partners are drawn from [pixels], give or take a block.
    size : int
        Side length of the tile, more than twice the radius and a power of two.

    Returns
    -------
    ndarray of int, shape (size, size, 2)
        As from :func:`pair_offsets`.
    """
    side = block_side(radius)
    blocks = pair_offsets(radius / side, size // side)
    count = len(blocks)
    row, column = np.indices((count, count))
    other = (row + blocks[..., 1]) % count, (column + blocks[..., 0]) % count
    masks = np.random.default_rng(_SEED).integers(0, side, blocks.shape)
    # Which pixel of the partner: x ^ mask, its own inverse; one mask for both blocks of a pair.
    masks ^= masks[other]
    y, x = np.indices((size, size))
    block, inner = (y // side, x // side), np.stack([x % side, y % side], axis=-1)
    return side * blocks[block] + (inner ^ masks[block]) - inner


def pairing_tile(radius: float) -> PairingTile:
    """Tile for a reuse radius [pixels], at least six radii wide."""
    size = 64
    while size < 6 * radius:
        size *= 2
    offsets = block_offsets(radius, size)
    # Dr.Jit would keep the memory of NumPy's arrays, and record a round of spatial reuse anew where
    # the tile of another is aligned differently; lists it copies.
    dx, dy = (mi.Int32(offsets[..., axis].ravel().tolist()) for axis in (0, 1))
    tile = PairingTile(dx, dy, mi.UInt32(size))
    dr.make_opaque(tile)
    return tile


def partner_offset(
    tile: PairingTile, choices: Stream, index: mi.UInt32, x: mi.UInt32, y: mi.UInt32
) -> tuple[mi.Int32, mi.Int32]:
    """Offset (columns, rows) from a place to its partner, in a plane that the tile covers.

    Parameters
    ----------
    choices : Stream
        Stream that is the same for all pixels: it draws the tile's offset and reflection.
    index : UInt32
        Number of the pairing.
    x, y : UInt32
        Column and row; a place left of or above the image is counted modulo 2^32.

    Returns
    -------
    dx, dy : Int32
        (0, 0) where there is no partner. The partner's offset is the negative.
    """
    u, v = uniform2(choices, index, 0)
    a, b = uniform2(choices, index, 1)
    swap, mirror = a < 0.5, b < 0.5
    # By whole blocks, so that those of the tile stay those of the grid.
    column = dr.select(swap, y, x) + mi.UInt32(u * tile.size) // BLOCK * BLOCK
    row = dr.select(swap, x, y) + mi.UInt32(v * tile.size) // BLOCK * BLOCK
    row = dr.select(mirror, tile.size - 1 - row % tile.size, row % tile.size)
    entry = row * tile.size + column % tile.size
    along = dr.gather(mi.Int32, tile.dx, entry)
    across = dr.gather(mi.Int32, tile.dy, entry)
    across = dr.select(mirror, -across, across)
    return dr.select(swap, across, along), dr.select(swap, along, across)
