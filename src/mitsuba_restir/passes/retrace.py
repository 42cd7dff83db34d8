"""Temporal retrace: bring the history's paths into the current scene before they are reused.

Lights, materials and geometry may have changed since a path was stored. Its random numbers have
not, so the same primary sample is traced again from the reconnection vertex on, and the whole path
is then shifted to its own pixel of the previous frame, in the current scene: the previous target
function is that of the new scene for both inputs of the temporal merge, and the Jacobian of this
shift carries the contribution weight over.

A path that did not exist in the old scene cannot be in the history, although the current scene's
target function says that it could be: where light reaches a surface that it did not reach before,
or where a bounce finds an area light that was elsewhere, the frame of the change is too dark, and
the error fades as the history refills. Directions are kept without the ratio of their old and new
pdfs, so materials must not change: reset the history then.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from ..paths.primary_hit import PrimaryHit
from ..paths.record import with_factor
from ..resampling.reservoir import Reservoir
from ..shifts.hybrid import shift
from ..shifts.mapping import Outcome
from ..shifts.scope import Scope
from ..shifts.suffix import retrace_suffix


def retrace(
    scope: Scope, history: Reservoir, hit: PrimaryHit, active: mi.Bool
) -> tuple[Reservoir, mi.Bool]:
    """Evaluate the history's paths again in the current scene.

    Parameters
    ----------
    history, hit : Reservoir, PrimaryHit
        The previous frame's reservoirs and primary hits, gathered to the current pixels.

    Returns
    -------
    reservoir : Reservoir
        The same paths in the current scene; weight 0 where a path no longer carries light.
    refused : Bool
        Lanes whose path is lost because its light or its weight is not finite.
    """
    active = active & (history.weight > 0)
    path = retrace_suffix(scope, history.path, hit, active).path
    renewed = shift(scope, path, hit, active)
    weight = history.weight * renewed.jacobian
    found = dr.max(renewed.color) > 0
    finite = dr.isfinite(weight)
    reservoir = Reservoir(
        with_factor(path, renewed.factor),
        renewed.color,
        dr.select(found & finite, weight, 0),
        history.confidence,
    )
    return reservoir, (renewed.outcome == Outcome.NOT_FINITE) | (found & ~finite)
