"""Temporal reuse: merge each pixel's reservoir with its history, with generalised balance MIS.

Lin et al. 2022 (GRIS), section 6: with confidences c, the canonical sample x and the history sample
x' shifted to y = T(x'),

    m_cur(x)  = c_cur p_cur(x) / (c_cur p_cur(x) + c_prev p_prev(T^-1 x) |dT^-1/dx|)
    m_prev(y) = c_prev p_prev(x') / J / (c_cur p_cur(y) + c_prev p_prev(x') / J).

The confidence of a history is added even where its shift fails: it took part.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit
from ..paths.spectrum import target
from ..resampling.mis import density, share
from ..resampling.reservoir import Reservoir, finalize, offer
from ..sampling.streams import TEMPORAL, pass_stream, uniform
from ..shifts.hybrid import shift
from ..shifts.mapping import ShiftMapping
from .reuse import with_confidence, with_factor


def temporal(
    scene: mi.Scene,
    sensor: mi.Sensor,
    current: Reservoir,
    hit: PrimaryHit,
    previous: Reservoir,
    previous_hit: PrimaryHit,
    valid: Any,
    cap: Any,
    sample: Any,
    seed: Any,
    mapping: ShiftMapping,
) -> tuple[Reservoir, Any]:
    """Resample between this frame's reservoirs and their re-projected history.

    Parameters
    ----------
    current, hit : Reservoir, PrimaryHit
        This frame's candidates and primary hits.
    previous, previous_hit : Reservoir, PrimaryHit
        History, already gathered to the current pixels.
    valid : Bool
        Lanes whose history passed the G-buffer tests.
    cap : float
        Confidence cap as a multiple of the current confidence.

    Returns
    -------
    reservoir : Reservoir
    outcomes : UInt32
        Outcomes of the two shifts (history to current, current to history), 3 bits each.
    """
    previous = with_confidence(
        previous,
        dr.select(valid, dr.minimum(previous.confidence, cap * current.confidence), 0),
    )
    reusable = valid & (previous.weight > 0)
    forward = shift(scene, sensor, previous.path, hit, mapping, reusable)
    backward = shift(
        scene, sensor, current.path, previous_hit, mapping, valid & (current.weight > 0)
    )

    own = current.confidence * target(current.color)
    m_current = share(own, density(previous.confidence, target(backward.color), backward.jacobian))
    theirs = density(previous.confidence, target(previous.color), 1 / forward.jacobian)
    m_previous = share(theirs, current.confidence * target(forward.color))

    pixel = dr.arange(mi.UInt32, dr.width(hit.vertex.p))
    random = pass_stream(TEMPORAL, pixel, sample, seed)
    merged = with_confidence(current, current.confidence + previous.confidence)
    merged.weight = mi.Float(0)
    merged = offer(
        merged,
        current.path,
        current.color,
        m_current * target(current.color) * current.weight,
        uniform(random, 0, 0),
        mi.Bool(True),
    )
    merged = offer(
        merged,
        with_factor(previous.path, forward.factor),
        forward.color,
        m_previous * target(forward.color) * forward.jacobian * previous.weight,
        uniform(random, 1, 0),
        reusable,
    )
    return finalize(merged, 1), forward.outcome | (backward.outcome << 3)
