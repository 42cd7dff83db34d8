"""What a strategy of finding neighbours answers: whose paths are merged, and with which weights.

A pair estimator needs the neighbour's path shifted here and this pixel's path shifted there. One
shift a neighbour is enough where neighbours are mutual, because the partner's shift is the other
half (:mod:`.paired`), and where they go round (:mod:`.ranked`). Neighbours that are mere picks take
both shifts (:mod:`.scored`).

What is handed on as confidence, like the choice itself and the number of neighbours, depends on the
G-buffer and on earlier confidences, never on the paths' values.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import drjit as dr
import mitsuba as mi

from ..resampling.pairwise import Pulled, Sharing
from ..resampling.reservoir import Reservoir
from ..sampling.streams import Stream

Found = TypeVar("Found")

TOGETHER = 3
"""Neighbours that a kernel shifts at most: what their shifts have in common is read once, and
compiling takes longer."""


@dataclass
class Exchange:
    """What spatial reuse merges.

    Fields: ``pulled`` (one per neighbour), ``shares`` (weights of the canonical sample in the
    pairs; 0 where a pair is not valid), ``confidence`` (what the merged reservoirs hand on),
    ``outcomes`` (of all shifts).
    """

    pulled: list[Pulled]
    shares: list[mi.Float]
    confidence: mi.Float
    outcomes: list[mi.UInt8]


@dataclass(frozen=True)
class Strategy:
    """A way to find neighbours.

    Attributes
    ----------
    layout : callable
        (radius [pixels]) -> what ``exchange`` needs, made once.
    exchange : callable
        (sharing, layout, reservoirs, choices) -> :class:`Exchange`; ``choices`` is a stream that
        all pixels share.
    """

    layout: Callable[[float], Any]
    exchange: Callable[[Sharing, Any, Reservoir, Stream], Exchange]


def for_each_neighbor(shift: Callable[[mi.UInt32], Found], neighbors: int) -> list[Found]:
    """What is found of every neighbour, by their numbers, :data:`TOGETHER` to a kernel."""
    size = -(-neighbors // -(-neighbors // TOGETHER))
    found: list[Found] = []
    for first in range(0, neighbors, size):
        numbers = range(first, min(first + size, neighbors))
        # Opaque, so that kernels of as many neighbours are the same.
        several = [shift(dr.opaque(mi.UInt32, number)) for number in numbers]
        dr.eval(several)
        found += several
    return found
