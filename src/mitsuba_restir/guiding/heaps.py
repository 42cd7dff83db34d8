"""Heaps of sums: every node of a cell's binary tree over its bins is the sum of its children.

What a frame adds is counted in integers, whose sums do not depend on the order of threads, so that
equal seeds make equal guides.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from .cells import CELLS
from .guide import LEVELS, NODES

UNIT = 2.0**-16
"""What an integer counts, relative to the largest value that is added."""

BINS = 1 << LEVELS
TOP = LEVELS // 2
"""Levels above the subtrees that are summed first."""


def nothing_counted() -> mi.UInt32:
    """Counters for the bins of all cells."""
    return dr.zeros(mi.UInt32, CELLS * BINS)


def count(
    counts: mi.UInt32, cell: mi.UInt32, leaf: mi.UInt32, value: mi.Float, active: mi.Bool
) -> None:
    """Add a value from 0 to 1 to a leaf of a cell's heap."""
    number = mi.UInt32(value / UNIT + 0.5)
    dr.scatter_add(counts, number, cell * BINS + leaf - BINS, active)


def grown(sums: mi.Float, memory: float, counts: mi.UInt32, largest: mi.Float) -> mi.Float:
    """Heaps with what a frame has counted.

    Parameters
    ----------
    sums : Float
        The heaps, cell after cell.
    memory : float
        What they count with.
    counts : UInt32
        The bins' counts, in units of ``largest`` times :data:`UNIT`.
    """
    heaps = dr.zeros(mi.Float, CELLS * NODES)
    lane = dr.arange(mi.UInt32, CELLS << TOP)
    cell, root = lane >> TOP, (1 << TOP) | (lane & ((1 << TOP) - 1))
    depth = LEVELS - TOP
    values = []
    for i in range(1 << depth):
        leaf = (root << depth) + i
        before = dr.gather(mi.Float, sums, cell * NODES + leaf)
        added = dr.gather(mi.UInt32, counts, cell * BINS + leaf - BINS)
        values.append(before * memory + mi.Float(added) * (largest * UNIT))
    _store(heaps, cell, root, values, depth)
    dr.eval(heaps)
    cell = dr.arange(mi.UInt32, CELLS)
    nodes = [dr.gather(mi.Float, heaps, cell * NODES + (1 << TOP) + i) for i in range(1 << TOP)]
    _store(heaps, cell, mi.UInt32(1), nodes, TOP)
    return heaps


def _store(
    heaps: mi.Float, cell: mi.UInt32, root: mi.UInt32, values: list[mi.Float], depth: int
) -> None:
    """Write a subtree's lowest nodes, ``depth`` levels below its root, and all sums above them."""
    while True:
        for i, value in enumerate(values):
            dr.scatter(heaps, value, cell * NODES + (root << depth) + i)
        if depth == 0:
            return
        values = [values[i] + values[i + 1] for i in range(0, len(values), 2)]
        depth -= 1
