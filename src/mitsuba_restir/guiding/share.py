"""How much of a cell's directions the guide gets: what would have cost least in the past.

The factor of a bounce in a candidate's weight w is 1 / r, r = alpha + (1 - alpha) g / p (see
:mod:`.steering`). With another alpha' the second moment of the candidates would have been that of
w^2 r / r': the mean over what came by, for a few alphas at a time, with the guide of the frame
before, which has not learnt from it. It is convex in alpha. So that a cell that has seen little
trusts the BSDF, its mean has some candidates that are made up, where the guide expects nothing.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from .cells import CELLS, UNIT
from .guide import COSTS

SHARES = (1.0, 0.9, 0.8, 0.65, 0.5)
"""Shares of the BSDF that are compared."""

MADE_UP = 4.0
"""Candidates that are made up."""

FORGETTING = 0.95
"""What the past counts with from frame to frame: the guide was a worse one."""


def nothing_paid() -> mi.UInt64:
    """A frame's bills before its first candidate."""
    return dr.zeros(mi.UInt64, CELLS * COSTS)


def pay(
    bills: mi.UInt64, cell: mi.UInt32, cost: mi.Float, ratio: mi.Float, active: mi.Bool
) -> None:
    """Add candidates to their cells' bills, by w^2 r (``cost``) and g / p (``ratio``)."""
    first = cell * COSTS
    dr.scatter_add(bills, mi.UInt64(1 / UNIT), first, active)
    for i, share in enumerate(SHARES):
        number = mi.UInt64(cost / (share + (1 - share) * ratio) / UNIT + 0.5)
        dr.scatter_add(bills, number, first + (i + 1), active)


def settled(costs: mi.Float, memory: float, bills: mi.UInt64) -> mi.Float:
    """The costs with a frame's bills."""
    return costs * (FORGETTING * memory) + mi.Float(bills) * UNIT


def cheapest(costs: mi.Float, known: mi.Bool) -> mi.Float:
    """The share of the BSDF of every cell; 1 where the guide is not ``known`` to be of use."""
    cell = dr.arange(mi.UInt32, CELLS)
    count, *totals = (dr.gather(mi.Float, costs, cell * COSTS + i) for i in range(COSTS))
    made_up = MADE_UP * totals[0] / count
    best, alpha = mi.Float(dr.inf), mi.Float(1)
    for share, total in zip(SHARES, totals, strict=True):
        cost = total + made_up / share
        better = cost < best
        best, alpha = dr.select(better, cost, best), dr.select(better, share, alpha)
    return dr.select(known, alpha, 1)


assert len(SHARES) + 1 == COSTS
