"""Refusing comparisons with a reference that is noisier than what is compared with it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from .results import Measured, ReferenceImage, Run

LIMIT = 0.5
"""Largest share of the measured squared error that may be the reference's own."""


class NoisyReferenceError(ValueError):
    """The reference is not sure enough for what is asked of it; the message says what to do."""


def check_reference(data: Measured, runs: Mapping[str, Sequence[Run]], quantity: str) -> None:
    """
    Refuse a reference that is too noisy.

    Parameters
    ----------
    runs : mapping of str to sequence of Run
        What is compared with it, of which the first run of every variant is looked at.
    quantity : str
        For the message.

    Raises
    ------
    NoisyReferenceError
        More than half of the relative squared error of some variant is the reference's own.
    """
    reference = data.reference
    if reference is None or not reference.variance.any():
        return
    for name, own in runs.items():
        if not own:
            continue
        share = _share(own[0], reference, data.epsilon)
        if share > LIMIT:
            raise NoisyReferenceError(
                f"{quantity} at {data.size} is not given: {100 * share:.0f} % of the squared error "
                f"of '{name}' is the reference's own noise; give the reference "
                f"{math.ceil(share / LIMIT)} times the samples, or more"
            )


def _share(run: Run, reference: ReferenceImage, epsilon: float) -> float:
    weight = 1.0 / (reference.image**2 + epsilon)
    measured = float(np.mean((run.last - reference.image) ** 2 * weight))
    return float(np.mean(reference.variance * weight)) / max(measured, 1e-30)
