"""Quantities of time: of a frame, frames per second, errors at equal time, error times time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ...analysis import intervals
from ...analysis.images import FloatArray
from ...analysis.intervals import Interval
from ..runs.results import Run
from . import noise
from .errors import means_of, relmse, trimmed_relmse
from .frame_errors import BLOTCHES, filtered_mse, frames_of
from .noise import Parts, shares
from .results import Measure, Measured, Number, Refused, Row
from .rows import lone, make_row, per_run, ratio_of, reference_of, unless_noisy


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


def frame_time(data: Measured, numbers: Sequence[Number]) -> Iterator[Row]:
    """
    Median time of a frame; as the ratio, the median over interleaved pairs of frames.

    Runs that were rendered at another time than the baseline's are no pairs.
    """
    (number,) = numbers
    for name, seconds in _times(data).items():
        ratio, p_value = None, None
        if pairs := _ratios_of_times(data, name):
            ratio = _median(pairs)
            if len(pairs) > 1:
                logarithms = [np.median(np.log(frames)) for frames in pairs]
                p_value = intervals.sign_flip_p_value(logarithms, np.zeros(len(pairs)))
        value = _median([1e3 * frames for frames in seconds])
        yield make_row(data, name, number, value, ratio, p_value)


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


def speed(data: Measured, numbers: Sequence[Number]) -> Iterator[Row]:
    """Frames per second and time per pixel, from the median time of a frame."""
    rate, of_a_pixel = numbers
    for name, seconds in _times(data).items():
        yield make_row(data, name, rate, _median([1.0 / frames for frames in seconds]))
        per_pixel = _median([1e9 * frames / data.pixels for frames in seconds])
        yield make_row(data, name, of_a_pixel, per_pixel)


def equal_time(data: Measured, numbers: Sequence[Number]) -> Iterator[Row | Refused]:
    """
    Error of one frame of the baseline at its time, over error times time of a variant.

    Above 1, a variant is better than the baseline given the same time. Three readings, always
    together: the last frame at its own time, the last frame charged with all frames, and the
    average of all frames. For the baseline itself only the last says anything: 1, but for noise and
    the time of averaging, or for what trimming does. Error and time are those of each run;
    there is an interval where the variant took turns with the baseline.
    """
    means = means_of(data)
    for title, trim, parts, readings in (
        ("equal time", 0.0, noise.relmse, numbers[:3]),
        ("equal time, trimmed", data.trim, noise.trimmed, numbers[3:]),
    ):
        found = shares(data, means, parts)
        yield from unless_noisy(data, title, found, _equal_time(data, trim, readings))


def _equal_time(data: Measured, trim: float, readings: Sequence[Number]) -> Iterator[Row]:
    base_runs = data.runs[data.baseline]
    base = np.array([_error_of_a_frame(data, r, trim) * np.median(r.times) for r in base_runs])
    for name, runs in data.runs.items():
        if not runs[0].times.size:
            continue
        last, average = (
            np.array([relmse(data, image, trim) for image in images])
            for images in ([run.last for run in runs], [run.mean for run in runs])
        )
        all_time = np.array([run.times.sum() for run in runs])
        costs = (last * [run.times[-1] for run in runs], last * all_time, average * all_time)
        # Times of frames that did not take turns with the baseline's are no pairs.
        paired = [run.session for run in base_runs] == [run.session for run in runs]
        for number, cost in list(zip(readings, costs, strict=True))[
            2 if name == data.baseline else 0 :
        ]:
            value, p_value = lone(float(base.mean() / cost.mean())), None
            if paired and len(runs) > 1:
                value = ratio_of(base, cost) or value
                p_value = intervals.sign_flip_p_value(base, cost)
            yield make_row(data, name, number, value, None, p_value)


def errors_and_times(data: Measured, numbers: Sequence[Number]) -> Iterator[Row | Refused]:
    """
    Trimmed relMSE and blotches of a frame, each times the median time of a frame of its run.

    What is smaller than a baseline's is better at equal time, as far as errors fall with the number
    of frames as those of independent frames do.
    """
    kinds: list[tuple[Measure, Parts]] = [(trimmed_relmse, noise.trimmed)]
    kinds += [(_seen_through(sigma), partial(noise.filtered, sigma=sigma)) for sigma in BLOTCHES]
    last = {name: [run.last for run in runs] for name, runs in data.runs.items()}
    timed = {name: [run for run in runs if run.times.size] for name, runs in data.runs.items()}
    for number, (measure, parts) in zip(numbers, kinds, strict=True):
        rows = per_run(replace(data, runs=timed), number, partial(_error_and_time, data, measure))
        yield from unless_noisy(data, number.name, shares(data, last, parts), rows)


def _seen_through(sigma: float) -> Measure:
    return lambda _, image, reference: filtered_mse(image[None], reference, sigma)


def _error_and_time(data: Measured, measure: Measure, run: Run) -> float:
    """Return error times milliseconds."""
    reference = reference_of(data)
    error = np.mean([measure(data, frame, reference) for frame in frames_of(data, run)])
    return float(error * 1e3 * np.median(run.times))


def _error_of_a_frame(data: Measured, run: Run, trim: float) -> float:
    """Mean over the frames of a run, where they are kept: one frame's error is very noisy."""
    frames = run.frames
    frames = run.last[None] if frames is None else frames
    return float(np.mean([relmse(data, frame, trim) for frame in frames]))
