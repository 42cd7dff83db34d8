"""The quantities that a study can measure, by name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..analysis import intervals, metrics, perceptual, spectrum
from ..analysis.covariance import covariance_ratio, relative_covariance
from ..analysis.images import FloatArray
from ..analysis.intervals import Interval
from .results import Image, Measured, ReferenceImage, Row, Run

_CLIP = 4.0
_SIGMA = 1.5


@dataclass(frozen=True)
class Quantity:
    """
    How one quantity is measured.

    Fields
    ------
    about : str
        One line for the user.
    rows : callable
        Measures every variant.
    needs_reference : bool
    cold : bool
        Only meaningful for runs without warm-up.
    """

    about: str
    rows: Callable[[Measured], Iterator[Row]]
    needs_reference: bool = False
    cold: bool = False


def _lone(value: float) -> Interval:
    nan = float("nan")
    return Interval(value, nan, nan, nan)


def _row(
    data: Measured, variant: str, quantity: str, unit: str, value: Interval, ratio: Interval | None
) -> Row:
    return Row(data.size, variant, quantity, unit, value, ratio, len(data.runs[variant]))


def _per_run(
    data: Measured, quantity: str, unit: str, measure: Callable[[Run], float]
) -> Iterator[Row]:
    """One number of each run: mean over runs, and ratio of means to the baseline."""
    values = {name: np.array([measure(run) for run in runs]) for name, runs in data.runs.items()}
    base = values[data.baseline]
    for name, own in values.items():
        value = intervals.mean_interval(own) if own.size > 1 else _lone(float(own[0]))
        ratio = _ratio(own, base) if name != data.baseline else None
        yield _row(data, name, quantity, unit, value, ratio)


def _ratio(own: FloatArray, base: FloatArray) -> Interval | None:
    if own.size < 2 or own.size != base.size:
        return None
    try:
        return intervals.ratio_interval(own, base)
    except ValueError:
        # Errors from which the reference's variance was subtracted may be negative.
        return None


def _reference(data: Measured) -> ReferenceImage:
    if data.reference is None:
        raise ValueError("There is no reference.")
    return data.reference


def _time(data: Measured) -> Iterator[Row]:
    times = {
        name: 1e3 * np.concatenate([run.times for run in runs]) for name, runs in data.runs.items()
    }
    base = times[data.baseline]
    for name, own in times.items():
        value = intervals.median_interval(own) if own.size > 1 else _lone(float(own[0]))
        ratio = None
        if name != data.baseline and own.size == base.size > 1:
            # Frame by frame: both were rendered one after the other, under the same load.
            ratio = intervals.median_interval(own / base)
        yield _row(data, name, "time of a frame", "ms", value, ratio)


def _of_last(
    name: str, measure: Callable[[Measured, Run, ReferenceImage], float], unit: str = ""
) -> Callable[[Measured], Iterator[Row]]:
    def rows(data: Measured) -> Iterator[Row]:
        reference = _reference(data)
        return _per_run(data, name, unit, lambda run: measure(data, run, reference))

    return rows


def _relmse(data: Measured, image: Image, trim: float) -> float:
    reference = _reference(data)
    return metrics.trimmed_relmse(
        image,
        reference.image,
        epsilon=data.epsilon,
        trim=trim,
        reference_variance=reference.variance,
    )


def _equal_time(data: Measured) -> Iterator[Row]:
    """
    Error of the baseline's single frame at its time, over error times time of a variant.

    Above 1, a variant is better than the baseline given the same time. Three readings, always
    together: the last frame at its own time, the last frame charged with all frames, and the
    average of all frames.
    """
    if any(len(runs) < 2 for runs in data.runs.values()):
        return
    frame_time = {n: float(np.median([r.times[-1] for r in runs])) for n, runs in data.runs.items()}
    all_times = {
        n: float(np.median([r.times.sum() for r in runs])) for n, runs in data.runs.items()
    }
    single = float(np.median(np.concatenate([r.times for r in data.runs[data.baseline]])))
    for label, trim in (("", 0.0), (", trimmed", data.trim)):
        base = np.array([_relmse(data, run.last, trim) for run in data.runs[data.baseline]])
        for name, runs in data.runs.items():
            if len(runs) != base.size:
                continue
            last = np.array([_relmse(data, run.last, trim) for run in runs])
            mean = np.array([_relmse(data, run.mean, trim) for run in runs])
            for reading, error, seconds in (
                ("last frame at its own time", last, frame_time[name]),
                ("last frame charged with all", last, all_times[name]),
                ("average of all frames", mean, all_times[name]),
            ):
                value = intervals.bootstrap_ratio(base * single, error * seconds)
                yield _row(data, name, f"equal time: {reading}{label}", "x", value, None)


def _covariance(data: Measured) -> Iterator[Row]:
    reference = _reference(data).image
    stacks = {name: np.stack([run.last for run in runs]) for name, runs in data.runs.items()}
    base = stacks[data.baseline]
    for name, own in stacks.items():
        if len(own) < 2:
            continue
        found = relative_covariance(own, reference)
        ratio = None
        if name != data.baseline and len(own) == len(base):
            ratio = covariance_ratio(own, base, reference)
        yield _row(data, name, "relative covariance r=8", "", found.covariance, ratio)
        yield _row(data, name, "relative covariance r=8, with j=i", "", found.with_self, None)
        yield _row(data, name, "mean correlation r=8", "", found.normalised, None)


def _errors(run: Run, reference: ReferenceImage) -> FloatArray:
    frames = run.last[None] if run.frames is None else run.frames
    errors = [spectrum.relative_error(image, reference.image, clip=_CLIP) for image in frames]
    return np.stack(errors)


def _bands(data: Measured) -> Iterator[Row]:
    reference = _reference(data)
    spectra = {
        name: np.stack([spectrum.power_spectrum(_errors(run, reference)) for run in runs])
        for name, runs in data.runs.items()
    }
    base = spectra[data.baseline]
    f = spectrum.frequencies(base.shape[1:])
    # Small images have no frequency in the lowest bands.
    bands = [
        (low, high)
        for low, high in (*spectrum.TABLE_BANDS, *spectrum.FINE_BANDS)
        if np.any((f >= low) & (f < high))
    ]
    for name, own in spectra.items():
        if len(own) < 2:
            continue
        other = base if name != data.baseline and len(own) == len(base) else None
        for found in spectrum.compare_bands(own, other, bands=bands):
            low, high = found.band
            yield _row(data, name, f"power {low:g}-{high:g}", "", found.power, found.ratio)


QUANTITIES: Mapping[str, Quantity] = {
    "time": Quantity("median time of a frame, and of interleaved pairs", _time),
    "rmse": Quantity(
        "root mean squared error of the last frame",
        _of_last(
            "RMSE",
            lambda _, run, r: metrics.rmse(run.last, r.image, reference_variance=r.variance),
        ),
        needs_reference=True,
    ),
    "relmse": Quantity(
        "relative mean squared error of the last frame",
        _of_last("relMSE", lambda data, run, _: _relmse(data, run.last, 0.0)),
        needs_reference=True,
    ),
    "relmse_trimmed": Quantity(
        "relMSE of the last frame without the worst pixels",
        _of_last("relMSE, trimmed", lambda data, run, _: _relmse(data, run.last, data.trim)),
        needs_reference=True,
    ),
    "relmse_average": Quantity(
        "relMSE of the average of all frames",
        _of_last("relMSE of the average", lambda data, run, _: _relmse(data, run.mean, 0.0)),
        needs_reference=True,
    ),
    "smape": Quantity(
        "symmetric mean absolute error of the last frame",
        _of_last("SMAPE", lambda _, run, r: metrics.smape(run.last, r.image)),
        needs_reference=True,
    ),
    "flip": Quantity(
        "HDR-FLIP of the last frame",
        _of_last("HDR-FLIP", lambda _, run, r: metrics.hdr_flip(run.last, r.image).mean),
        needs_reference=True,
    ),
    "mean_ratio": Quantity(
        "mean luminance of all frames over the reference's",
        _of_last("mean ratio", lambda _, run, r: metrics.mean_ratio(run.mean, r.image)),
        needs_reference=True,
    ),
    "filtered_mse": Quantity(
        "mean squared relative error of the last frame seen through a Gaussian of 1.5 pixels",
        _of_last(
            "filtered MSE, 1.5 px",
            lambda _, run, r: perceptual.filtered_mse(_errors(run, r), _SIGMA),
        ),
        needs_reference=True,
    ),
    "equal_time": Quantity(
        "relMSE at equal time against one frame of the baseline", _equal_time, True, cold=True
    ),
    "covariance": Quantity(
        "relative covariance of the last frames of the runs", _covariance, needs_reference=True
    ),
    "bands": Quantity(
        "power of the relative error by frequency band", _bands, needs_reference=True
    ),
}


def measure_all(names: Sequence[str], data: Measured) -> list[Row]:
    """
    Measure quantities, in the order of their names.

    Raises
    ------
    ValueError
        An image holds values that are not finite, or a quantity has no baseline to refer to.
    ImportError
        A quantity needs a package that is not installed.
    """
    if not data.runs.get(data.baseline):
        raise ValueError(f"the baseline '{data.baseline}' has no finished run")
    return [row for name in names for row in QUANTITIES[name].rows(data)]
