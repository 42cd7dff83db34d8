"""Temporal reuse: merge each pixel's reservoir with its history, with generalised balance MIS.

Lin et al. 2022 (GRIS), section 6: with confidences c, the canonical sample x and the history sample
x' shifted to y = T(x'),

    m_cur(x)  = c_cur p_cur(x) / (c_cur p_cur(x) + c_prev p_prev(T^-1 x) |dT^-1/dx|)
    m_prev(y) = c_prev p_prev(x') / J / (c_cur p_cur(y) + c_prev p_prev(x') / J).

The confidence of a history is added even where its shift fails: it took part.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit
from ..paths.record import PathRecord, with_factor
from ..paths.spectrum import target
from ..resampling.mis import canonical_share, density, share
from ..resampling.reservoir import Reservoir, Streaming, finalize, fits, is_sound, offer
from ..sampling.streams import Purpose, uniform
from ..shifts.hybrid import Shifted, shift
from ..shifts.mapping import MERGE_REFUSED, Outcome
from ..shifts.scope import Scope


@dataclass
class Previous:
    """The history at each pixel's previous place.

    Fields: ``reservoirs``, ``hit``, ``valid`` (the history passed the G-buffer tests).
    """

    reservoirs: Reservoir
    hit: PrimaryHit
    valid: mi.Bool


YOUNG = 2.0
"""Largest confidence of a history, relative to the candidates that each pixel has had in it.

Spatial reuse adds up the confidences of neighbours that share most of what they hold: after three
frames they would be at any cap, and the first frame would count for most of the picture until so
many frames as the cap have passed. At 1 all frames count alike, and pixels are noisier at first.
"""


def capped(previous: Previous, current: Reservoir, cap: float, trees: mi.UInt32) -> Reservoir:
    """The history's reservoirs, with a confidence that is not more than it is worth.

    Parameters
    ----------
    cap : float
        Largest confidence, as a multiple of the current one.
    trees : UInt32
        Candidates that each pixel has had in the history.
    """
    most = dr.minimum(cap * current.confidence, YOUNG * mi.Float(trees))
    confidence = dr.minimum(previous.reservoirs.confidence, most)
    return replace(previous.reservoirs, confidence=dr.select(previous.valid, confidence, 0))


@dataclass
class Exchange:
    """What history and current frame make of each other's paths.

    Fields: ``path`` (the history's, as a record of this frame), ``forward`` (it, shifted to the
    current pixel), ``backward`` (the current path, shifted to the history's pixel).
    """

    path: PathRecord
    forward: Shifted
    backward: Shifted


def temporal(
    scope: Scope, current: Reservoir, hit: PrimaryHit, previous: Previous, cap: float
) -> tuple[Reservoir, mi.UInt32]:
    """Resample between this frame's reservoirs and their re-projected history.

    Parameters
    ----------
    current, hit : Reservoir, PrimaryHit
        This frame's candidates and primary hits.
    cap : float
        Confidence cap as a multiple of the current confidence.

    Returns
    -------
    reservoir, outcomes
        See :func:`merge_history`.
    """
    history = previous.reservoirs
    forward = shift(scope, history.path, hit, reusable(previous))
    backward = shift(scope, current.path, previous.hit, shareable(current, previous))
    exchange = Exchange(history.path, forward, backward)
    return merge_history(scope, current, previous, exchange, cap)


def reusable(previous: Previous) -> mi.Bool:
    """Lanes whose history has a path."""
    return previous.valid & (previous.reservoirs.weight > 0)


def shareable(current: Reservoir, previous: Previous) -> mi.Bool:
    """Lanes that have a path which the history could have had."""
    return previous.valid & (current.weight > 0)


def merge_history(
    scope: Scope, current: Reservoir, previous: Previous, exchange: Exchange, cap: float
) -> tuple[Reservoir, mi.UInt32]:
    """Merge each pixel's reservoir with its history, given each other's shifted paths.

    Returns
    -------
    reservoir : Reservoir
    outcomes : UInt32
        Outcomes of the two shifts (history to current, current to history), 3 bits each, and
        :data:`mitsuba_restir.shifts.mapping.MERGE_REFUSED`.
    """
    history = capped(previous, current, cap, scope.key.sample)
    forward, backward = exchange.forward, exchange.backward

    own = current.confidence * target(current.color)
    m_current = canonical_share(
        own, density(history.confidence, target(backward.color), backward.jacobian)
    )
    theirs = density(history.confidence, target(history.color), 1 / forward.jacobian)
    m_history = share(theirs, current.confidence * target(forward.color))

    random = scope.key.stream(Purpose.TEMPORAL, scope.grid.pixels())
    streaming = Streaming(current.path, current.color, mi.Float(0))
    streaming = offer(
        streaming,
        current.path,
        current.color,
        m_current * target(current.color) * current.weight,
        uniform(random, 0, 0),
        mi.Bool(True),
    )
    weight = m_history * target(forward.color) * forward.jacobian * history.weight
    refused = reusable(previous) & (forward.outcome == Outcome.OK) & ~fits(streaming, weight)
    outcome = dr.select(refused, Outcome.NOT_FINITE, forward.outcome)
    streaming = offer(
        streaming,
        with_factor(exchange.path, forward.factor),
        forward.color,
        weight,
        uniform(random, 1, 0),
        reusable(previous),
    )
    confidence = current.confidence + history.confidence
    merged = finalize(streaming, 1, confidence)
    sound = is_sound(merged.weight, streaming.total)
    outcomes = outcome | (backward.outcome << 3) | dr.select(sound, mi.UInt32(0), MERGE_REFUSED)
    return dr.select(sound, merged, replace(current, confidence=confidence)), outcomes
