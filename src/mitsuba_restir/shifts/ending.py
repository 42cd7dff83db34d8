"""How a path ends: the integrand after its replayed prefix, and its factor of the Jacobian."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..paths.record import Kind, PathRecord
from ..paths.scattering import LightSample, balance, nee_weight
from .connectability import Link


@dataclass
class Ends:
    """What the ending of a shifted path is computed from.

    Fields: ``kind`` of the path; ``value`` and ``pdf`` of the BSDF at y_{k-1}, ``value_k`` and
    ``pdf_k`` at x_k; ``light`` (a light sampled from y_{k-1}); ``emitted`` and ``emitted_pdf``
    (radiance of the light found, and density of sampling it); ``hit_pdf`` (of the last replayed
    bounce).
    """

    kind: mi.UInt32
    value: mi.Spectrum
    pdf: mi.Float
    value_k: mi.Spectrum
    pdf_k: mi.Float
    light: LightSample
    emitted: mi.Spectrum
    emitted_pdf: mi.Float
    hit_pdf: mi.Float


def ending(path: PathRecord, e: Ends) -> mi.Spectrum:
    """Integrand of everything after the replayed prefix, by kind of path."""
    leave = dr.select(e.pdf > 0, e.value / e.pdf, 0)
    leave_k = dr.select(e.pdf_k > 0, e.value_k / e.pdf_k, 0)
    result = leave * leave_k * path.radiance  # FAR
    result = dr.select(e.kind == Kind.HIT, result * balance(e.pdf_k, path.light_pdf), result)
    result = dr.select(
        e.kind == Kind.NEE,
        leave * e.value_k * path.radiance * nee_weight(path.light_pdf, e.pdf_k),
        result,
    )
    result = dr.select(
        e.kind == Kind.LIGHT, leave * e.emitted * balance(e.pdf, e.emitted_pdf), result
    )
    result = dr.select(
        e.kind == Kind.ENVIRONMENT, leave * path.radiance * balance(e.pdf, path.light_pdf), result
    )
    result = dr.select(
        e.kind == Kind.REPLAY_NEE,
        e.value * e.light.weight * dr.select(e.light.delta, 1, balance(e.light.pdf, e.pdf)),
        result,
    )
    return dr.select(
        e.kind == Kind.REPLAY_HIT, e.emitted * balance(e.hit_pdf, e.emitted_pdf), result
    )


def own_factor(kind: mi.UInt32, pair: Link, pdf_k: mi.Float) -> mi.Float:
    """p G p, a path's own part of the reconnection Jacobian; 1 without a reconnection vertex."""
    sampled = (kind == Kind.FAR) | (kind == Kind.HIT)
    return dr.select(kind < Kind.FAR, 1, pair.area_pdf * dr.select(sampled, pdf_k, 1))
