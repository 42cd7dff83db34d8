"""Reservoirs: one selected path per pixel with its confidence and unbiased contribution weight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from ..paths.record import PathRecord, empty_record
from ..paths.spectrum import target


@dataclass
class Reservoir:
    """A resampled path.

    Fields: ``path`` (:class:`PathRecord`), ``color`` (``Color3f``: the integrand F of the path in
    this pixel's primary sample space), ``weight`` (``Float``: the unbiased contribution weight W;
    while streaming the running sum of resampling weights), ``confidence`` (``Float``: M).
    """

    path: PathRecord
    color: Any
    weight: Any
    confidence: Any


def empty_reservoir(continued: bool) -> Reservoir:
    """A reservoir that has seen nothing; ``continued`` as in :func:`empty_record`."""
    return Reservoir(empty_record(continued), mi.Color3f(0), mi.Float(0), mi.Float(0))


def offer(
    reservoir: Reservoir, path: PathRecord, color: Any, weight: Any, u: Any, active: Any
) -> Reservoir:
    """Stream one candidate through the reservoir (weighted reservoir sampling, Chao 1982).

    Parameters
    ----------
    color : Color3f
        The candidate's integrand F in this pixel.
    weight : Float
        Its resampling weight w = m p-hat W; not positive means "not a candidate".
    u : Float
        Uniform number from a stream that no path uses.
    """
    weight = dr.select(active & (weight > 0), weight, 0)
    total = reservoir.weight + weight
    take = u * total < weight
    return Reservoir(
        dr.select(take, path, reservoir.path),
        dr.select(take, color, reservoir.color),
        total,
        reservoir.confidence,
    )


def finalize(reservoir: Reservoir, count: Any) -> Reservoir:
    """Turn the running sum into the unbiased contribution weight W = sum w / (count p-hat)."""
    selected = target(reservoir.color)
    weight = dr.select(selected > 0, reservoir.weight / (count * selected), 0)
    return Reservoir(reservoir.path, reservoir.color, weight, reservoir.confidence)
