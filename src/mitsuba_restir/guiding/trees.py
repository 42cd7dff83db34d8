"""Trees of sums: the bins of every cell, the sums of pairs of them, and so on to the cell's total.

A level of all cells is one array, cell after cell; the children of entry i are 2 i and 2 i + 1 of
the next one. What a frame adds to the bins is counted in integers, whose sums do not depend on the
order of threads, so that equal seeds make equal guides.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from .cells import CELLS, UNIT
from .guide import LEVELS


def nothing_counted() -> mi.UInt32:
    """Counters for the bins of all cells."""
    return dr.zeros(mi.UInt32, CELLS << LEVELS)


def count(
    counts: mi.UInt32, cell: mi.UInt32, leaf: mi.UInt32, value: mi.Float, active: mi.Bool
) -> None:
    """Add a value from 0 to 1 to a bin of a cell."""
    leaf |= cell << LEVELS
    # A copy of the counters for every thread would take longer to clear than to share them.
    mode = dr.ReduceMode.Direct
    dr.scatter_add(counts, mi.UInt32(value / UNIT + 0.5), leaf, active, mode)


def grown(
    sums: list[mi.Float], memory: float, counts: mi.UInt32, largest: mi.Float
) -> list[mi.Float]:
    """Trees with what a frame has counted.

    Parameters
    ----------
    sums : list of Float
        The levels, the totals first.
    memory : float
        What they count with.
    counts : UInt32
        Of the bins, in units of ``largest`` times :data:`.cells.UNIT`.
    """
    levels = [sums[-1] * memory + mi.Float(counts) * (largest * UNIT)]
    for level in range(LEVELS - 1, -1, -1):
        dr.eval(levels)
        left = 2 * dr.arange(mi.UInt32, CELLS << level)
        pair = (dr.gather(mi.Float, levels[0], left + i) for i in range(2))
        levels.insert(0, sum(pair))
    return levels
