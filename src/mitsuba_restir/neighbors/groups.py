"""Groups of scattered pixels: blocks of cells, of each of which a group has one random pixel.

Anew in every frame and round, the image is cut into blocks of n x n cells at a random offset. The
pixels of every cell are dealt out to the groups of its block. Labels tell which pixels of a group
see like surfaces.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..paths.grid import Grid
from ..paths.primary_hit import PrimaryHit
from ..paths.vertex import exists
from ..sampling.dither import MaskTexture
from ..sampling.streams import Stream, uniform2

SLAB = 0.5
"""Thickness of the slabs of space that tell surfaces apart, at most, relative to their distance."""

NOWHERE = 0xFFFFFFFF
"""Label of pixels that see no surface, and of places outside the image."""

CELLS = 8
"""Cells along a block's side, if pixels allow it."""

SPREAD = 1.35
"""Side of a block relative to the radius of reuse. In the mean square, two random points of a block
are then 1.1 times as far apart as the centre and a random point of a disk with the radius."""

# Blocks of the round's stream; its vertices number the blocks' cells, or the purposes below.
_CELLS, COMMON = 2, 3
_OFFSET, TURN, _MASK, _SLABS = range(4)


@dataclass
class Groups:
    """How pixels are grouped.

    Attributes
    ----------
    mask : MaskTexture
        Whose ranks decide.
    cells : int
        Cells along a side of a block, n; at most 16.
    side : int
        Side of a cell [pixels].
    """

    mask: MaskTexture
    cells: int
    side: int


@dataclass
class Members:
    """The groups' pixels, group after group, one lane each.

    Fields: ``pixel`` (in the grid; 0 outside), ``inside`` (lies in the image), ``level`` (of the
    mask).
    """

    pixel: mi.UInt32
    inside: mi.Bool
    level: mi.UInt32


def scattered_groups(mask: MaskTexture, radius: float) -> Groups:
    """Groups in which two pixels are about as far apart as a disk's random point from its centre.

    Parameters
    ----------
    radius : float
        Of the disk [pixels].
    """
    side = max(1, round(SPREAD * radius / CELLS))
    return Groups(mask, max(2, round(SPREAD * radius / side)), side)


def surface_labels(hits: PrimaryHit, choices: Stream) -> mi.UInt32:
    """Labels that like surfaces share: the same main direction and slab of space.

    Parameters
    ----------
    choices : Stream
        Moves the slabs' limits, so that no surface is cut for ever.
    """
    direction = dr.round(hits.normal)
    span = hits.vertex.p - hits.origin
    a, b = uniform2(choices, _SLABS, COMMON)
    octave = dr.floor(dr.log2(dr.norm(span)) + a)
    thickness = SLAB * dr.exp2(octave - a)
    slab = dr.floor(dr.dot(dr.normalize(direction), span) / thickness + b)
    facing = mi.UInt32(direction.x + 3 * direction.y + 9 * direction.z + 13)
    label = facing | ((mi.UInt32(mi.Int32(octave)) & 0x7F) << 5) | (mi.UInt32(mi.Int32(slab)) << 12)
    return dr.select(exists(hits.vertex), label, NOWHERE)


def members(grid: Grid, groups: Groups, choices: Stream) -> Members:
    """Cut an image into groups.

    Parameters
    ----------
    choices : Stream
        The round's stream: draws the offset of the blocks, the pixel that each group has in each
        cell, and the offset of the mask.
    """
    cells, side = groups.cells, groups.side
    size, block_side, per_block = cells * cells, cells * side, side * side
    columns, rows = (-(-extent // block_side) + 1 for extent in (grid.columns, grid.rows))
    columns_opaque = dr.opaque(mi.UInt32, columns)
    lane = dr.arange(mi.UInt32, columns * rows * per_block * size)
    group, member = lane // size, lane % size
    block, inner = group // per_block, group % per_block
    row = block // columns_opaque
    column = block - row * columns_opaque
    left, top = choices.words(_OFFSET, COMMON)
    # A random toroidal shift of each cell deals its pixels out to the groups of the block.
    dx, dy = choices.words(block * size + member, _CELLS)
    x = column * block_side + member % cells * side + (inner % side + dx) % side
    y = row * block_side + member // cells * side + (inner // side + dy) % side
    x, y = mi.Int32(x - left % block_side), mi.Int32(y - top % block_side)
    inside = grid.contains(x, y)
    key, _ = choices.words(_MASK, COMMON)
    level = groups.mask.level(x, y, key)
    return Members(dr.select(inside, grid.index(mi.UInt32(x), mi.UInt32(y)), 0), inside, level)
