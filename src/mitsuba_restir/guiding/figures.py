"""Figures of a guide at work, for the statistics of a frame."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit
from .guide import CELLS, NODES, Guide, cell_at, known
from .steering import share_of_bsdf


def cells_in_use(guide: Guide) -> float:
    """Share of the table's cells that have seen light."""
    cells = NODES * dr.arange(mi.UInt32, CELLS)
    found = known(guide, cells, dr.full(mi.Bool, True, CELLS))
    return float(dr.mean(mi.Float(found))[0])


def mean_share_of_bsdf(guide: Guide, hit: PrimaryHit, alpha: float) -> float:
    """Mean probability with which the first bounce of a pixel's path comes from the BSDF.

    Parameters
    ----------
    hit : PrimaryHit
        One lane per pixel; those that hit nothing, or an instance, do not count.
    alpha : float
        See :func:`mitsuba_restir.guiding.steering.share_of_bsdf`.
    """
    # The geometry is not asked: it may have been edited since the frame.
    there = hit.vertex.shape != None  # noqa: E711  (element-wise)
    cell = cell_at(guide, hit.vertex.p, hit.normal)
    share = share_of_bsdf(guide, cell, hit.vertex.shape.bsdf(), alpha, there)
    guided = dr.sum(dr.select(there, 1 - share, 0))
    return float((1 - guided / dr.maximum(dr.count(there), 1))[0])
