"""Rows of numbers from runs: means, ratios to the baseline, or a refusal instead of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping

import numpy as np

from ...analysis import intervals
from ...analysis.images import FloatArray
from ...analysis.intervals import Interval, Jackknife
from ..runs.results import ReferenceImage, Run
from .noise import refusal
from .results import Measured, Number, Refused, Row


def lone(value: float) -> Interval:
    """Return a value without an interval."""
    nan = float("nan")
    return Interval(value, nan, nan, nan)


def interval_of(values: FloatArray) -> Interval:
    """Return the mean over runs, (K,), with its interval where there are two."""
    return intervals.mean_interval(values) if values.size > 1 else lone(float(values[0]))


def make_row(
    data: Measured,
    variant: str,
    number: Number,
    value: Interval,
    ratio: Interval | None = None,
    p_value: float | None = None,
) -> Row:
    """Return a row of a variant with the number of its runs."""
    runs = len(data.runs[variant])
    return Row(data.size, variant, number.name, number.unit, value, ratio, runs, p_value)


def per_run(data: Measured, number: Number, measure: Callable[[Run], float]) -> Iterator[Row]:
    """One number of each run: mean over runs, and ratio of means to the baseline."""
    values = {name: np.array([measure(run) for run in runs]) for name, runs in data.runs.items()}
    yield from rows_of_runs(data, number, values)


def rows_of_runs(data: Measured, number: Number, values: Mapping[str, FloatArray]) -> Iterator[Row]:
    """Rows from one number of each run of every variant."""
    for name, own in values.items():
        if not own.size:
            continue
        ratio, p_value = None, None
        if partner := data.partner(name):
            ratio = ratio_of(own, values[partner])
            p_value = intervals.sign_flip_p_value(own, values[partner])
        yield make_row(data, name, number, interval_of(own), ratio, p_value)


def row_of_jackknife(
    data: Measured, variant: str, number: Number, own: Jackknife, base: Jackknife | None
) -> Row:
    """
    Return the row of a statistic of all runs, beside that of the baseline's if there is one.

    A baseline that may be zero, such as the covariance of independent pixels, makes no ratio.
    """
    ratio = p_value = None
    if base is not None:
        p_value, against = own.p_value_against(base), base.interval()
        ratio = None if against.low <= 0.0 <= against.high else own.over(base)
    return make_row(data, variant, number, own.interval(), ratio, p_value)


def ratio_of(own: FloatArray, base: FloatArray) -> Interval | None:
    """Return the ratio of two means over the same runs; None where it is not defined."""
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


def unless_noisy(
    data: Measured, title: str, shares: Mapping[str, float], rows: Iterable[Row | Refused]
) -> Iterator[Row | Refused]:
    """
    Give rows, or refuse them all where too much of them is the reference's own noise.

    Parameters
    ----------
    title : str
        What is refused.
    shares : mapping of str to float
        As of `noise.shares`.
    rows : iterable
        Asked for only where they are given.
    """
    if refused := refusal(data.size, title, shares):
        yield refused
    else:
        yield from rows
