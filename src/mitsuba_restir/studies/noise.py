"""Refusing comparisons with a reference that is noisier than what is compared with it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from .results import Image, Measured, ReferenceImage, Run

Checked = Literal["last", "mean"]

LIMIT = 0.5
"""Largest share of the measured squared error that may be the reference's own."""


class NoisyReferenceError(ValueError):
    """The reference is not sure enough for what is asked of it; the message says what to do."""


def check_reference(
    data: Measured, runs: Mapping[str, Sequence[Run]], quantity: str, image: Checked = "last"
) -> None:
    """
    Refuse a reference that is too noisy.

    Parameters
    ----------
    runs : mapping of str to sequence of Run
        What is compared with it.
    quantity : str
        For the message.
    image : {"last", "mean"}
        Whether the last frame of a run is compared with it or the mean of all.

    Raises
    ------
    NoisyReferenceError
        More than half of the relative squared error of some variant is the reference's own.
    """
    reference = data.reference
    if reference is None or not reference.variance.any():
        return
    shares = {
        name: _share([getattr(run, image) for run in own], reference, data.epsilon)
        for name, own in runs.items()
        if own
    }
    worst = max(shares, key=shares.__getitem__, default="")
    if worst and shares[worst] > LIMIT:
        share = shares[worst]
        raise NoisyReferenceError(
            f"{quantity} at {data.size} is not given: {100 * share:.0f} % of the squared error of "
            f"'{worst}' is the reference's own noise; {_advice(share)}"
        )


def _share(images: Sequence[Image], reference: ReferenceImage, epsilon: float) -> float:
    """Part of the squared error of images, mean over them, that is the reference's own."""
    weight = 1.0 / (reference.image**2 + epsilon)
    errors = [np.mean((image - reference.image) ** 2 * weight) for image in images]
    return float(np.mean(reference.variance * weight)) / max(float(np.mean(errors)), 1e-30)


def _advice(share: float) -> str:
    """
    Say how many times the samples are enough.

    With n times the samples, share / n of what is measured now is the reference's, and 1 - share
    remains the image's.
    """
    if share >= 1.0:
        return "how many samples it needs cannot be told, since no other error is seen beside it"
    times = math.ceil(share / (1.0 - share) * (1.0 - LIMIT) / LIMIT)
    return f"give the reference {times} times the samples, or more"
