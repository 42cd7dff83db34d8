"""How a path ends: the integrand after its replayed prefix, and its factor of the Jacobian."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr

from ..paths import record as kinds
from ..paths.record import PathRecord
from ..paths.scattering import balance, nee_weight
from .connectability import Link


@dataclass
class Ends:
    """What the ending of a shifted path is computed from; see :func:`_ending`."""

    kind: Any
    value: Any
    pdf: Any
    value_k: Any
    pdf_k: Any
    light: Any
    emitted: Any
    emitted_pdf: Any
    hit_pdf: Any


def ending(path: PathRecord, e: Ends) -> Any:
    """Integrand of everything after the replayed prefix, by kind of path."""
    leave = dr.select(e.pdf > 0, e.value / e.pdf, 0)
    leave_k = dr.select(e.pdf_k > 0, e.value_k / e.pdf_k, 0)
    result = leave * leave_k * path.radiance  # FAR
    result = dr.select(e.kind == kinds.HIT, result * balance(e.pdf_k, path.light_pdf), result)
    result = dr.select(
        e.kind == kinds.NEE,
        leave * e.value_k * path.radiance * nee_weight(path.light_pdf, e.pdf_k),
        result,
    )
    result = dr.select(
        e.kind == kinds.LIGHT, leave * e.emitted * balance(e.pdf, e.emitted_pdf), result
    )
    result = dr.select(
        e.kind == kinds.ENVIRONMENT, leave * path.radiance * balance(e.pdf, path.light_pdf), result
    )
    result = dr.select(
        e.kind == kinds.REPLAY_NEE,
        e.value * e.light.weight * dr.select(e.light.delta, 1, balance(e.light.pdf, e.pdf)),
        result,
    )
    return dr.select(
        e.kind == kinds.REPLAY_HIT, e.emitted * balance(e.hit_pdf, e.emitted_pdf), result
    )


def jacobian_factor(kind: Any, pair: Link, pdf_k: Any) -> Any:
    """This path's own factor of the reconnection Jacobian (1 without a reconnection vertex)."""
    sampled = (kind == kinds.FAR) | (kind == kinds.HIT)
    return dr.select(kind < kinds.FAR, 1, pair.jacobian * dr.select(sampled, pdf_k, 1))
