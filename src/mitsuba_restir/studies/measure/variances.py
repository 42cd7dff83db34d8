"""Relative variance of unbiased frames, and what it costs: variance times time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...analysis.images import FloatArray
from ...analysis.intervals import Jackknife
from ..runs.results import Run
from . import noise
from .frame_errors import frames_of, relative_errors
from .results import Measured, Number, Refused, Row
from .rows import reference_of, row_of_jackknife, unless_noisy


@dataclass(frozen=True)
class _Squares:
    """
    Squared relative errors of one variant.

    Fields
    ------
    pixels : array, (K, P)
        Of every pixel, mean over the frames of each run.
    seconds : array, (K,)
        Median time of a frame of each run; empty where nothing was rendered.
    """

    pixels: FloatArray
    seconds: FloatArray


def variances(data: Measured, numbers: Sequence[Number]) -> Iterator[Row | Refused]:
    """
    Mean square of the relative error of luminance, which is the variance where nothing is biased.

    The trimmed value leaves out the pixels that vary most, in all frames of all runs together. Both
    also times the median time of a frame: what is smaller than a baseline's has less variance at
    equal time. The statistics are of all runs, their intervals by a jackknife.
    """
    last = {name: [run.last for run in runs] for name, runs in data.runs.items()}
    found = noise.shares(data, last, noise.relative)
    yield from unless_noisy(data, numbers[0].name, found, _rows(data, numbers))


def _rows(data: Measured, numbers: Sequence[Number]) -> Iterator[Row]:
    squares = {name: _squares(data, runs) for name, runs in data.runs.items() if len(runs) > 1}
    kinds = [(trim, timed) for timed in (False, True) for trim in (0.0, data.trim)]
    for number, (trim, timed) in zip(numbers, kinds, strict=True):
        statistics: Mapping[str, Jackknife] = {
            name: _variance(data, own, trim, timed)
            for name, own in squares.items()
            if own.seconds.size or not timed
        }
        for name, own in statistics.items():
            base = statistics.get(data.partner(name) or "")
            yield row_of_jackknife(data, name, number, own, base)


def _squares(data: Measured, runs: Sequence[Run]) -> _Squares:
    reference = reference_of(data)
    pixels = [
        np.mean(relative_errors(frames_of(data, run), reference, None) ** 2, axis=0).ravel()
        for run in runs
    ]
    return _Squares(
        np.stack(pixels), np.array([np.median(run.times) for run in runs if run.times.size])
    )


def _variance(data: Measured, squares: _Squares, trim: float, timed: bool) -> Jackknife:
    """Return the statistic; in milliseconds where it is timed."""
    reference = reference_of(data)
    own = (reference.luminance_variance / reference.scale**2).ravel()

    def statistic(kept: npt.NDArray[np.intp]) -> float:
        pixels = squares.pixels[kept].mean(axis=0)
        calm = np.argsort(pixels)[: pixels.size - int(trim * pixels.size)]
        value = float(np.mean(pixels[calm] - own[calm]))
        return value * 1e3 * float(squares.seconds[kept].mean()) if timed else value

    everyone = np.arange(len(squares.pixels))
    left_out = [statistic(np.delete(everyone, k)) for k in everyone]
    return Jackknife(statistic(everyone), np.array(left_out))
