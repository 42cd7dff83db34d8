"""What a still says of itself: how far it is, and the picture in the end."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from ..imageio import Image
from .plan import Plan


@dataclass(frozen=True)
class Progress:
    """
    How far a still is.

    Attributes
    ----------
    frames : int
    error, untrimmed : float
        The stated error, as of the last decision and by the 1 / sqrt(frames) law since then;
        infinite before the first.
    seconds : float
        Time taken so far.
    left : float or None
        Time left [s], by the same law; None where that cannot be said yet.
    """

    frames: int
    error: float
    untrimmed: float
    seconds: float
    left: float | None


@dataclass(frozen=True)
class Still:
    """
    A picture and what is known of it.

    Attributes
    ----------
    image, standard_error : arrays, (H, W, 3)
        Linear colour, and the standard error of each of its values.
    error, untrimmed : float
        Relative error, root mean square over the pixels, as the variance of the frames has it:
        without the worst 0.1 % of the pixels, and with them. See :func:`.error.stated`.
    frames : int
        Number of frames that the picture is the mean of.
    seconds : float
        Time taken, with the pilot that chose the plan.
    plan : Plan
    why : str
        Why this plan.
    denoised : array, (H, W, 3), or None
    aovs : mapping of str to array, (H, W, C)
        Means of the auxiliary images, by name.
    remark : str
        What else should be known; often nothing.
    """

    image: Image
    standard_error: Image
    error: float
    untrimmed: float
    frames: int
    seconds: float
    plan: Plan
    why: str
    denoised: Image | None
    aovs: Mapping[str, Image]
    remark: str


def stopwatch(
    before: float = 0.0, now: Callable[[], float] = time.perf_counter
) -> Callable[[], float]:
    """Seconds from here on, and ``before`` them."""
    begin = now()
    return lambda: before + now() - begin
