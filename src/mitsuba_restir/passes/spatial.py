"""Spatial reuse: every pixel merges its path with those of its neighbours, round by round."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from ..neighbors.exchange import Strategy
from ..resampling.pairwise import PairEstimators, Sharing, merge
from ..resampling.reservoir import Reservoir
from ..sampling.streams import Purpose
from ..shifts.mapping import MERGE_REFUSED


@dataclass
class Merged:
    """What a round of spatial reuse leaves.

    Fields: ``reservoirs``, ``color`` (mean of the pair estimators), ``estimators``, ``outcomes``
    (of the shifts; the first with :data:`mitsuba_restir.shifts.mapping.MERGE_REFUSED`).
    """

    reservoirs: Reservoir
    color: mi.Color3f
    estimators: PairEstimators
    outcomes: list[mi.UInt8]


def spatial(
    sharing: Sharing,
    strategy: Strategy,
    layout: Any,
    reservoirs: Reservoir,
    round_index: mi.UInt32,
) -> Merged:
    """One round of spatial reuse.

    Parameters
    ----------
    strategy, layout : Strategy, Any
        How neighbours are found, and the data that it made for that.
    round_index : UInt32
        Number of the round (opaque).
    """
    key = sharing.scope.key
    # Common to all pixels, and anew for every round.
    choices = key.stream(Purpose.NEIGHBORS, round_index)
    exchange = strategy.exchange(sharing, layout, reservoirs, choices)
    selection = key.stream(Purpose.SPATIAL, sharing.scope.grid.pixels()).fork(round_index)
    reservoirs, color, estimators = merge(
        reservoirs, exchange.pulled, exchange.shares, exchange.confidence, selection
    )
    tried, kept = mi.Bool(False), mi.Bool(False)
    for theirs, valid in zip(exchange.pulled, estimators.valid[1:], strict=True):
        tried |= theirs.valid
        kept |= valid
    refused = dr.select(tried & ~kept, mi.UInt8(MERGE_REFUSED), 0)
    first, *others = exchange.outcomes
    return Merged(reservoirs, color, estimators, [first | refused, *others])
