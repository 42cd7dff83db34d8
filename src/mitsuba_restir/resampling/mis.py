"""MIS weights of the resampling steps: generalised balance (Talbot) and defensive pairwise.

Source: Lin et al. 2022 (GRIS), section 5 and its supplement; confidence weights as in the course
notes of Wyman et al. 2023.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi


def share(own: mi.Float, other: mi.Float) -> mi.Float:
    """own / (own + other), 0 where nothing can produce the sample.

    NaN where single precision cannot hold the sum: a sample of such a weight is refused.
    """
    total = own + other
    return dr.select(dr.isfinite(total), dr.select(total > 0, own / total, 0), dr.nan)


def canonical_share(own: mi.Float, other: mi.Float) -> mi.Float:
    """The share of a pixel's own sample: all, where the other's :func:`share` has it refused."""
    return dr.select(dr.isfinite(own + other), share(own, other), 1)


def density(confidence: mi.Float, target: mi.Float, jacobian: mi.Float) -> mi.Float:
    """Confidence-weighted density c p-hat |J| of a technique at a sample.

    ``jacobian`` is that of the map from the sample's domain to the technique's.
    """
    return confidence * target * jacobian
