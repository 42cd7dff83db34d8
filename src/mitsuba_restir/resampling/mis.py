"""MIS weights of the resampling steps: generalised balance (Talbot) and defensive pairwise.

Source: Lin et al. 2022 (GRIS), section 5 and its supplement; confidence weights as in the course
notes of Wyman et al. 2023.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi


def share(own: mi.Float, other: mi.Float) -> mi.Float:
    """own / (own + other), 0 where nothing can produce the sample."""
    total = own + other
    return dr.select(total > 0, own / total, 0)


def density(confidence: mi.Float, target: mi.Float, jacobian: mi.Float) -> mi.Float:
    """Confidence-weighted density c p-hat |J| of a technique at a sample.

    ``jacobian`` is that of the map from the sample's domain to the technique's.
    """
    return confidence * target * jacobian
