"""Quantities of pictures that take seconds: what they are worth, and whether what they state holds.

Efficiency needs no reference but for its scale: how far pictures are off is the spread of several.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from ...analysis.images import FloatArray, luminance
from ...analysis.intervals import Jackknife
from ...analysis.metrics import trimmed_mean
from ...still.error import FLOOR
from ..config.study import Study
from ..runs.results import Run
from ..runs.stills import TYPE
from .errors import hdr_flip, means_of, trimmed_relmse
from .noise import shares, trimmed
from .results import Measured, Number, Refused, Row
from .rows import make_row, reference_of, unless_noisy

Kept = npt.NDArray[np.intp]


def efficiencies(data: Measured, numbers: Sequence[Number]) -> Iterator[Row]:
    """
    How many times longer the baseline takes for the same variance of its mean.

    Variance x time of the baseline over that of a variant. Variances are those between the means of
    runs, relative to the reference squared: of all pixels, without the worst, of the median pixel.
    """
    means: dict[str, FloatArray] = {
        name: np.stack(images).astype(np.float64)
        for name, images in means_of(data).items()
        if images
    }
    seconds = {name: np.array([run.times.sum() for run in data.runs[name]]) for name in means}
    scale = reference_of(data).image ** 2 + data.epsilon
    for name, own in means.items():
        if (base := data.partner(name)) is None:
            continue

        def worth(
            kept: Kept, own: FloatArray = own, name: str = name, base: str = base
        ) -> FloatArray:
            costs = [
                _three(images[kept].var(axis=0, ddof=1) / scale, data.trim) * times[kept].mean()
                for images, times in ((means[base], seconds[base]), (own, seconds[name]))
            ]
            return costs[0] / costs[1]

        yield from _rows(data, name, numbers, worth)


def _three(relative: FloatArray, trim: float) -> FloatArray:
    """Mean over the pixels, without the largest, and of the median pixel."""
    return np.array(
        [relative.mean(), trimmed_mean(relative, trim), np.median(relative.mean(axis=2))]
    )


def stated_over_true(data: Measured, numbers: Sequence[Number]) -> Iterator[Row]:
    """What stills state as their error over the spread of several; 1 where they are right."""
    for name, runs in data.runs.items():
        said = [run.stated for run in runs if run.stated is not None]
        if len(said) < 2 or len(said) != len(runs):
            continue
        says = np.array([(each**2).mean(axis=0) for each in said])
        images = np.stack([run.last for run in runs]).astype(np.float64)

        def ratio(kept: Kept, says: FloatArray = says, images: FloatArray = images) -> FloatArray:
            mean, variance = images[kept].mean(axis=0), images[kept].var(axis=0, ddof=1)
            relative = variance / (mean**2 + (FLOOR * luminance(mean).mean()) ** 2)
            true = np.array([trimmed_mean(relative), relative.mean()])
            return np.sqrt(says[kept].mean(axis=0) / true)

        yield from _rows(data, name, numbers, ratio)


def as_long_as(data: Measured, numbers: Sequence[Number]) -> Iterator[Row | Refused]:
    """
    How many times longer `path` takes for the same error: relMSE, trimmed, and HDR-FLIP.

    Its variants with the same kind of frame, denoised or not, are points of a curve. Between them,
    and beyond, the logarithm of the error is taken to be linear in that of the time.
    """
    found = shares(data, means_of(data), trimmed)
    yield from unless_noisy(data, numbers[0].name, found, _as_long_as(data, numbers))


def _as_long_as(data: Measured, numbers: Sequence[Number]) -> Iterator[Row]:
    measured = {name: _errors_and_seconds(data, runs) for name, runs in data.runs.items() if runs}
    for name, own in measured.items():
        curve = [measured[rival] for rival in data.rivals.get(name, ()) if rival in measured]
        if name in data.rivals.get(name, ()) or len(curve) < 2:
            continue
        if any(len(rival) != len(own) for rival in curve):
            continue

        def longer(
            kept: Kept, own: FloatArray = own, curve: Sequence[FloatArray] = tuple(curve)
        ) -> FloatArray:
            points = np.array([rival[kept].mean(axis=0) for rival in curve])
            *errors, time = own[kept].mean(axis=0)
            return np.array(
                [as_long(points[:, [-1, i]], error) / time for i, error in enumerate(errors)]
            )

        yield from _rows(data, name, numbers, longer)


def _errors_and_seconds(data: Measured, runs: Sequence[Run]) -> FloatArray:
    """Return both errors of the mean of every run, and what it took [s], (K, 3)."""
    reference = reference_of(data)
    return np.array(
        [
            (
                trimmed_relmse(data, run.mean, reference),
                hdr_flip(data, run.mean, reference),
                run.times.sum(),
            )
            for run in runs
        ]
    )


def as_long(curve: FloatArray, error: float) -> float:
    """
    Return the time at which a curve has an error.

    Parameters
    ----------
    curve : array, (N, 2)
        Times and errors, N at least 2.
    error : float

    Returns
    -------
    float
        NaN where the curve does not fall there, or an error is not positive.
    """
    if min(error, *curve[:, 1]) <= 0.0:
        return float("nan")
    times, errors = np.log(curve[np.argsort(curve[:, 0])]).T
    falls = np.minimum.accumulate(errors)
    # The segment in which the error lies; the first or the last one where it is beyond.
    i = int(np.clip(np.searchsorted(-falls, -np.log(error)), 1, len(times) - 1))
    slope = (falls[i] - falls[i - 1]) / (times[i] - times[i - 1])
    if not slope < 0:
        return float("nan")
    return float(np.exp(times[i] + (np.log(error) - falls[i]) / slope))


def _rows(
    data: Measured, name: str, numbers: Sequence[Number], statistic: Callable[[Kept], FloatArray]
) -> Iterator[Row]:
    """Rows of a statistic of a choice of runs, with intervals of its logarithm by a jackknife."""
    everyone = np.arange(len(data.runs[name]))
    one = Jackknife(1.0, np.ones(everyone.size))
    values = statistic(everyone)
    left_out = np.array([statistic(np.delete(everyone, k)) for k in everyone])
    for i, number in enumerate(numbers):
        if np.isfinite(values[i]):
            own = Jackknife(float(values[i]), left_out[:, i])
            yield make_row(data, name, number, own.over(one))


def notes_on_stills(label: str, runs: Mapping[str, Sequence[Run]]) -> list[str]:
    """Say what the stills of each variant were rendered with, and why."""
    notes = []
    for name, own in runs.items():
        found = dict.fromkeys(run.remark for run in own if run.remark)
        notes += [f"{name} at {label}: {remark}" for remark in found]
    return notes


def rivals_of(study: Study) -> dict[str, list[str]]:
    """Name the variants of `path` with the same kind of frame, for every variant."""
    return {
        name: [
            other
            for other, rival in study.variants.items()
            if rival.type == "path" and rival.denoise == variant.denoise
        ]
        for name, variant in study.variants.items()
    }


def lacks_rivals(study: Study) -> str:
    """Say that no variant has two points of a curve of `path` to be compared with."""
    rivals = rivals_of(study)
    if any(len(found) > 1 and name not in found for name, found in rivals.items()):
        return ""
    return "needs two variants of type path, and another one, all denoised or none"


def lacks_stills(study: Study) -> str:
    """Say that no variant states an error."""
    stills = any(variant.type == TYPE for variant in study.variants.values())
    return "" if stills else f"needs a variant of type {TYPE}"
