"""Figures of a guide at work, for the statistics of a frame."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit
from .cells import Cells, cell_at
from .guide import Guide, alpha_at
from .steering import steerable


def cells_in_use(guide: Guide) -> float:
    """Share of the table's cells that have seen light."""
    return float(dr.mean(mi.Float(guide.sums[0] > 0))[0])


def mean_share_of_bsdf(cells: Cells, guide: Guide, hit: PrimaryHit) -> float:
    """Mean probability with which the first bounce of a pixel's path comes from the BSDF.

    Parameters
    ----------
    hit : PrimaryHit
        One lane per pixel; those that hit nothing, or an instance, do not count.
    """
    # The geometry is not asked: it may have been edited since the frame.
    there = hit.vertex.shape != None  # noqa: E711  (element-wise)
    cell = cell_at(cells, hit.vertex.p, hit.normal)
    share = alpha_at(guide, cell, 1, there & steerable(hit.vertex.shape.bsdf()))
    guided = dr.sum(dr.select(there, 1 - share, 0))
    return float((1 - guided / dr.maximum(dr.count(there), 1))[0])
