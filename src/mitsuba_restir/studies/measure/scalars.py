"""Quantities that are one number of each run, and what follows from them: errors and times."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from ...analysis import intervals, metrics
from ...analysis.images import FloatArray
from ...analysis.intervals import Interval, Jackknife
from ..runs.results import Image, ReferenceImage, Run
from . import noise
from .frame_errors import CLIP, frames_of, mean_square
from .noise import Parts, refusal, shares
from .results import Measured, Refused, Row

Measure = Callable[[Measured, Image, ReferenceImage], float]
"""Measures a frame (H, W, 3)."""


def lone(value: float) -> Interval:
    """Return a value without an interval."""
    nan = float("nan")
    return Interval(value, nan, nan, nan)


def make_row(
    data: Measured,
    variant: str,
    quantity: str,
    unit: str,
    value: Interval,
    ratio: Interval | None,
    runs: int | None = None,
    p_value: float | None = None,
) -> Row:
    """Return a row of a variant, by default with the number of its runs."""
    count = len(data.runs[variant]) if runs is None else runs
    return Row(data.size, variant, quantity, unit, value, ratio, count, p_value)


def per_run(
    data: Measured, quantity: str, unit: str, measure: Callable[[Run], float]
) -> Iterator[Row]:
    """One number of each run: mean over runs, and ratio of means to the baseline."""
    values = {name: np.array([measure(run) for run in runs]) for name, runs in data.runs.items()}
    yield from rows_of_runs(data, quantity, unit, values)


def rows_of_runs(
    data: Measured, quantity: str, unit: str, values: Mapping[str, FloatArray]
) -> Iterator[Row]:
    """Rows from one number of each run of every variant."""
    for name, own in values.items():
        if not own.size:
            continue
        value = intervals.mean_interval(own) if own.size > 1 else lone(float(own[0]))
        ratio, p_value = None, None
        if partner := data.partner(name):
            ratio = _ratio(own, values[partner])
            p_value = intervals.sign_flip_p_value(own, values[partner])
        yield make_row(data, name, quantity, unit, value, ratio, p_value=p_value)


def row_of_jackknife(
    data: Measured, variant: str, quantity: str, own: Jackknife, base: Jackknife | None
) -> Row:
    """
    Return the row of a statistic of all runs, beside that of the baseline's if there is one.

    A baseline that may be zero, such as the covariance of independent pixels, makes no ratio.
    """
    ratio = p_value = None
    if base is not None:
        p_value, against = own.p_value_against(base), base.interval()
        ratio = None if against.low <= 0.0 <= against.high else own.over(base)
    return make_row(data, variant, quantity, "", own.interval(), ratio, p_value=p_value)


def _ratio(own: FloatArray, base: FloatArray) -> Interval | None:
    try:
        return intervals.ratio_interval(own, base)
    except ValueError:
        # Errors from which the reference's variance was subtracted may be negative.
        return None


def reference_of(data: Measured) -> ReferenceImage:
    """Return the reference (ValueError where there is none)."""
    if data.reference is None:
        raise ValueError("There is no reference.")
    return data.reference


def _times(data: Measured) -> dict[str, list[FloatArray]]:
    """Seconds of the measured frames of every run, for the variants that were rendered."""
    found = {
        name: [run.times for run in runs if run.times.size] for name, runs in data.runs.items()
    }
    return {name: times for name, times in found.items() if times}


def _median(runs: Sequence[FloatArray]) -> Interval:
    """
    Median over the frames of all runs, with Student's interval of the runs' medians.

    Frames of one run are no independent measurements: they share the load of the machine.
    """
    value = float(np.median(np.concatenate(runs)))
    if len(runs) < 2:
        return lone(value)
    spread = intervals.mean_interval([np.median(frames) for frames in runs])
    half = spread.high - spread.value
    return Interval(value, value - half, value + half, spread.standard_error)


def frame_time(data: Measured) -> Iterator[Row]:
    """
    Median time of a frame; as the ratio, the median over interleaved pairs of frames.

    Runs that were rendered at another time than the baseline's are no pairs.
    """
    for name, seconds in _times(data).items():
        value = _median([1e3 * frames for frames in seconds])
        ratio, p_value = None, None
        if pairs := _ratios_of_times(data, name):
            ratio = _median(pairs)
            if len(pairs) > 1:
                logarithms = [np.median(np.log(frames)) for frames in pairs]
                p_value = intervals.sign_flip_p_value(logarithms, np.zeros(len(pairs)))
        yield make_row(data, name, "time of a frame", "ms", value, ratio, p_value=p_value)


def _ratios_of_times(data: Measured, name: str) -> list[FloatArray]:
    """
    Times of a variant over its baseline's, frame by frame, of every run where both took turns.

    Both frames of a pair were rendered one after the other, under the same load.
    """
    other = data.baselines.get(name, data.baseline)
    if other == name:
        return []
    return [
        own.times / base.times
        for own, base in zip(data.runs[name], data.runs.get(other, ()), strict=False)
        if own.session == base.session and own.times.size == base.times.size > 0
    ]


def speed(data: Measured) -> Iterator[Row]:
    """Frames per second and time per pixel, from the median time of a frame."""
    for name, seconds in _times(data).items():
        rate = _median([1.0 / frames for frames in seconds])
        yield make_row(data, name, "frames per second", "", rate, None)
        per_pixel = _median([1e9 * frames / data.pixels for frames in seconds])
        yield make_row(data, name, "time of a pixel", "ns", per_pixel, None)


def of_frames(
    name: str,
    measure: Measure,
    parts: Parts,
    frames: Callable[[Measured, Run], Image] = frames_of,
) -> Callable[[Measured], Iterator[Row | Refused]]:
    """
    Make a quantity of one number of each run: the mean over its frames.

    Parameters
    ----------
    measure : callable
        Measures a frame.
    parts : callable
        Of the last frame of a run, what is measured and what of it is the reference's own noise.
    frames : callable
        Chooses the frames.
    """

    def rows(data: Measured) -> Iterator[Row | Refused]:
        reference = reference_of(data)
        last = {variant: [run.last for run in runs] for variant, runs in data.runs.items()}
        if refused := refusal(data.size, name, shares(data, last, parts)):
            yield refused
            return

        def measure_run(run: Run) -> float:
            return float(np.mean([measure(data, image, reference) for image in frames(data, run)]))

        yield from per_run(data, name, "", measure_run)

    return rows


def of_mean(
    name: str, measure: Measure, parts: Parts
) -> Callable[[Measured], Iterator[Row | Refused]]:
    """Make a quantity of the mean of all measured frames of each run; arguments as `of_frames`."""

    def rows(data: Measured) -> Iterator[Row | Refused]:
        reference = reference_of(data)
        if refused := refusal(data.size, name, shares(data, means_of(data), parts)):
            yield refused
            return
        yield from per_run(data, name, "", lambda run: measure(data, run.mean, reference))

    return rows


def means_of(data: Measured) -> dict[str, list[Image]]:
    """Return the mean of all frames of every run, by variant."""
    return {name: [run.mean for run in runs] for name, runs in data.runs.items()}


def relmse(data: Measured, image: ArrayLike, trim: float) -> float:
    """Relative mean squared error with the study's epsilon and the reference's own variance."""
    reference = reference_of(data)
    return metrics.trimmed_relmse(
        image,
        reference.image,
        epsilon=data.epsilon,
        trim=trim,
        reference_variance=reference.variance,
    )


def rmse(_: Measured, image: Image, reference: ReferenceImage) -> float:
    """RMSE without the reference's own variance; a `Measure`."""
    return metrics.rmse(image, reference.image, reference_variance=reference.variance)


def whole_relmse(data: Measured, image: Image, _: ReferenceImage) -> float:
    """relMSE of all pixels; a `Measure`."""
    return relmse(data, image, 0.0)


def hdr_flip(_: Measured, image: Image, reference: ReferenceImage) -> float:
    """Mean HDR-FLIP; a `Measure`."""
    return metrics.hdr_flip(image, reference.image)


def relative_rmse(data: Measured) -> Iterator[Row | Refused]:
    """Root mean squared relative error of luminance: clipped at +-4, and as it is beside it."""
    for label, clip, parts in ((", clipped", CLIP, noise.clipped), ("", None, noise.relative)):

        def measure(
            _: Measured, image: Image, r: ReferenceImage, clip: float | None = clip
        ) -> float:
            return float(np.sqrt(max(mean_square(image[None], r, clip), 0.0)))

        yield from of_frames(f"relative RMSE{label}", measure, parts)(data)


def equal_time(data: Measured) -> Iterator[Row | Refused]:
    """
    Error of one frame of the baseline at its time, over error times time of a variant.

    Above 1, a variant is better than the baseline given the same time. Three readings, always
    together: the last frame at its own time, the last frame charged with all frames, and the
    average of all frames. For the baseline itself only the last says anything: 1, but for noise and
    the time of averaging, or for what trimming does. Error and time are those of each run;
    there is an interval where the variant took turns with the baseline.
    """
    for label, trim, parts in (("", 0.0, noise.relmse), (", trimmed", data.trim, noise.trimmed)):
        title = f"equal time{label}"
        if refused := refusal(data.size, title, shares(data, means_of(data), parts)):
            yield refused
            continue
        base = np.array(
            [
                _error_of_a_frame(data, run, trim) * np.median(run.times)
                for run in data.runs[data.baseline]
            ]
        )
        sessions = [run.session for run in data.runs[data.baseline]]
        for name, runs in data.runs.items():
            if not runs[0].times.size:
                continue
            last, average = (
                np.array([relmse(data, image, trim) for image in images])
                for images in ([run.last for run in runs], [run.mean for run in runs])
            )
            all_time = np.array([run.times.sum() for run in runs])
            readings = [("average of all frames", average * all_time)]
            if name != data.baseline:
                readings = [
                    ("last frame at its own time", last * [run.times[-1] for run in runs]),
                    ("last frame charged with all", last * all_time),
                    *readings,
                ]
            for reading, cost in readings:
                value, p_value = lone(float(base.mean() / cost.mean())), None
                # Times of frames that did not take turns with the baseline's are no pairs.
                if sessions == [run.session for run in runs] and len(runs) > 1:
                    value = _ratio(base, cost) or value
                    p_value = intervals.sign_flip_p_value(base, cost)
                quantity = f"equal time: {reading}{label}"
                yield make_row(data, name, quantity, "x", value, None, p_value=p_value)


def _error_of_a_frame(data: Measured, run: Run, trim: float) -> float:
    """Mean over the frames of a run, where they are kept: one frame's error is very noisy."""
    frames = run.frames
    frames = run.last[None] if frames is None else frames
    return float(np.mean([relmse(data, frame, trim) for frame in frames]))
