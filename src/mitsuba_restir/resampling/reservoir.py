"""Reservoirs: one selected path per pixel with its confidence and unbiased contribution weight."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..paths.record import Form, PathRecord, empty_record
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


@dataclass
class Refused:
    """Candidates that no reservoir takes, because their weight is not finite in single precision.

    One of them in a reservoir would be reused for ever, by ever more pixels.

    Fields: ``color`` (sum of their contributions: shown in their own frame, once), ``count``.
    """

    color: mi.Color3f
    count: mi.UInt32


def none_refused() -> Refused:
    """No candidate."""
    return Refused(mi.Color3f(0), mi.UInt32(0))


def refuse(refused: Refused, contribution: mi.Color3f, active: mi.Bool) -> Refused:
    """Add a candidate that contributes ``contribution`` to its pixel."""
    return Refused(
        refused.color + dr.select(active, contribution, 0),
        refused.count + dr.select(active, mi.UInt32(1), 0),
    )


def fits(streaming: Streaming, weight: mi.Float) -> mi.Bool:
    """Lanes where a reservoir can take a candidate of a weight: their sum is finite."""
    return dr.isfinite(streaming.total + weight)


def empty_reservoir(form: Form) -> Reservoir:
    """The reservoir of a pixel without a path."""
    return Reservoir(empty_record(form), mi.Color3f(0), mi.Float(0), mi.Float(0))


def empty_streaming(form: Form) -> Streaming:
    """A reservoir that has seen nothing."""
    return Streaming(empty_record(form), mi.Color3f(0), mi.Float(0))


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
        Its resampling weight w = m p-hat W; not positive means "not a candidate", and neither is
        what does not fit (:func:`fits`).
    u : Float
        Uniform number from a stream that no path uses.
    """
    weight = dr.select(active & (weight > 0) & fits(streaming, weight), weight, 0)
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


def is_sound(weight: mi.Float, total: mi.Float) -> mi.Bool:
    """Lanes where single precision can hold W, if anything of the sum ``total`` was selected."""
    return (total == 0) | ((weight > 0) & (weight < dr.inf))
