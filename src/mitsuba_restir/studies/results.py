"""What a study has produced: runs, the reference, and rows of numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..analysis.intervals import Interval

Image = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Run:
    """
    One finished run of one variant.

    Fields
    ------
    last, mean : array, (H, W, 3)
        Last measured frame, and the mean of all measured frames.
    times : array, (frames,)
        Seconds of each measured frame.
    frames : array, (frames, H, W, 3), or None
        Every measured frame, where the study keeps all.
    """

    last: Image
    mean: Image
    times: npt.NDArray[np.float64]
    frames: Image | None = None


@dataclass(frozen=True)
class ReferenceImage:
    """
    The truth and how sure it is.

    Fields
    ------
    image, variance : array, (H, W, 3)
        Mean, and variance of the mean (zero where unknown).
    """

    image: npt.NDArray[np.float64]
    variance: npt.NDArray[np.float64]


@dataclass(frozen=True)
class Measured:
    """
    All that a quantity is measured from, at one size.

    Fields
    ------
    size : str
        As in "320x180".
    runs : mapping of str to sequence of Run
        The finished runs of each variant, in order.
    baseline : str
        The variant that ratios refer to.
    reference : ReferenceImage or None
    epsilon, trim : float
        Of relMSE and its trimmed value.
    """

    size: str
    runs: Mapping[str, Sequence[Run]]
    baseline: str
    reference: ReferenceImage | None
    epsilon: float
    trim: float


@dataclass(frozen=True)
class Row:
    """
    One number of one variant.

    Fields
    ------
    size, variant, quantity, unit : str
    value : Interval
        Its interval is NaN where a single run allows none.
    ratio : Interval or None
        Ratio to the baseline; None for the baseline itself or where it is not defined.
    runs : int
        Independent runs behind the value.
    """

    size: str
    variant: str
    quantity: str
    unit: str
    value: Interval
    ratio: Interval | None
    runs: int
