"""How fast a variant that learns gets better than its baseline, from a cold start."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ...analysis.images import FloatArray
from ...analysis.intervals import Jackknife
from ..runs.results import Run
from . import noise
from .errors import means_of, relmse
from .noise import shares
from .results import Measured, Number, Refused, Row
from .rows import make_row, unless_noisy


def half_gains(data: Measured, numbers: Sequence[Number]) -> Iterator[Row | Refused]:
    """
    Frames until half of the gain over the baseline is there.

    The gain is the logarithm of the ratio of trimmed relMSEs, of means over runs; all of it is its
    mean over the last third of the frames. Where that is no gain, there is no number.
    """
    found = shares(data, means_of(data), noise.trimmed)
    yield from unless_noisy(data, numbers[0].name, found, _rows(data, numbers))


def _rows(data: Measured, numbers: Sequence[Number]) -> Iterator[Row]:
    (number,) = numbers
    errors = {name: _errors(data, runs) for name, runs in data.runs.items()}
    for name, own in errors.items():
        if partner := data.partner(name):
            everyone, base = np.arange(len(own)), errors[partner]
            value = half_gain(own, base)
            left_out = [half_gain(np.delete(own, k, 0), np.delete(base, k, 0)) for k in everyone]
            if np.isfinite(value):
                interval = Jackknife(value, np.array(left_out)).interval()
                yield make_row(data, name, number, interval)


def _errors(data: Measured, runs: Sequence[Run]) -> FloatArray:
    """Trimmed relMSE of every frame of every run, (K, F)."""
    return np.array(
        [[relmse(data, f, data.trim) for f in run.load_frames()] for run in runs if run.load_frames]
    )


def half_gain(own: FloatArray, base: FloatArray) -> float:
    """
    Return the frame, from 1 and between frames, at which half of the gain is first there.

    Parameters
    ----------
    own, base : array, (K, F)
        Errors of each frame of each run.

    Returns
    -------
    float
        NaN where there is no gain in the end, or an error is not positive.
    """
    means = own.mean(axis=0), base.mean(axis=0)
    if min(map(np.min, means)) <= 0.0:
        return float("nan")
    gain = np.log(means[1] / means[0])
    half = 0.5 * float(np.mean(gain[-max(len(gain) // 3, 1) :]))
    if half <= 0.0:
        return float("nan")
    t = int(np.argmax(gain >= half))
    if t == 0:
        return 1.0
    return float(t + (half - gain[t - 1]) / (gain[t] - gain[t - 1]))
