"""Reservoirs: one selected path per pixel with its confidence and unbiased contribution weight."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..paths.record import PathRecord, empty_record
from ..paths.spectrum import target


@dataclass
class Reservoir:
    """A resampled path.

    Fields: ``path``, ``color`` (the integrand F of the path in this pixel's primary sample space),
    ``weight`` (the unbiased contribution weight W), ``confidence`` (the confidence weight M).
    """

    path: PathRecord
    color: mi.Color3f
    weight: mi.Float
    confidence: mi.Float


@dataclass
class Streaming:
    """A reservoir that candidates are still streamed through.

    Fields: ``path`` and ``color`` as in :class:`Reservoir`, ``total`` (the sum of the resampling
    weights so far).
    """

    path: PathRecord
    color: mi.Color3f
    total: mi.Float


def empty_reservoir(continued: bool) -> Reservoir:
    """The reservoir of a pixel without a path; ``continued`` as in :func:`empty_record`."""
    return Reservoir(empty_record(continued), mi.Color3f(0), mi.Float(0), mi.Float(0))


def empty_streaming(continued: bool) -> Streaming:
    """A reservoir that has seen nothing; ``continued`` as in :func:`empty_record`."""
    return Streaming(empty_record(continued), mi.Color3f(0), mi.Float(0))


def offer(
    streaming: Streaming,
    path: PathRecord,
    color: mi.Color3f,
    weight: mi.Float,
    u: mi.Float,
    active: mi.Bool,
) -> Streaming:
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
    total = streaming.total + weight
    take = u * total < weight
    return Streaming(
        dr.select(take, path, streaming.path), dr.select(take, color, streaming.color), total
    )


def finalize(streaming: Streaming, count: mi.Float | int, confidence: mi.Float) -> Reservoir:
    """Turn the sum into the unbiased contribution weight W = sum w / (count p-hat)."""
    selected = target(streaming.color)
    weight = dr.select(selected > 0, streaming.total / (count * selected), 0)
    return Reservoir(streaming.path, streaming.color, weight, confidence)
