"""Quantities of what does not average out: means, blocks of pixels, single pixels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy import stats

from ...analysis import intervals, metrics
from ...analysis.bias import MeanTest, mean_test
from ...analysis.images import FloatArray, luminance
from ...analysis.intervals import Interval
from ...analysis.pixel_bias import mean_bias, squared_pixel_bias
from ..runs.results import ReferenceImage, Run
from .errors import means_of
from .noise import relative, shares
from .results import Measured, Number, Refused, Row
from .rows import lone, make_row, per_run, reference_of, unless_noisy

BLOCK = 8
_LEVEL = 0.05
LEAST_RUNS = 4
"""From fewer, no block could be told to be off."""


def mean_ratios(data: Measured, numbers: Sequence[Number]) -> Iterator[Row]:
    """Mean luminance of all frames over the reference's, whose error is in the interval."""
    (number,) = numbers
    reference = reference_of(data).unsmoothed
    rows = per_run(data, number, lambda run: metrics.mean_ratio(run.mean, reference.image))
    for row in rows:
        total = float(np.sqrt(reference.luminance_variance.sum()))
        error = row.value.value * total / float(reference.luminance.sum())
        yield replace(row, value=intervals.with_known_error(row.value, row.runs, error))


def paired_mean(data: Measured, numbers: Sequence[Number]) -> Iterator[Row]:
    """Relative difference of mean luminance from the baseline, over the same runs."""
    (number,) = numbers
    for name, runs in data.runs.items():
        if partner := data.partner(name):
            own, base = _means(runs), _means(data.runs[partner])
            means = (images.mean(axis=(1, 2)) for images in (own, base))
            p_value = intervals.sign_flip_p_value(*means)
            yield make_row(data, name, number, mean_bias(own, base), None, p_value)


def block_test(runs: Sequence[Run], reference: ReferenceImage) -> MeanTest:
    """Test blocks of pixels of the mean of all frames against the reference before smoothing."""
    sharp = reference.unsmoothed
    return mean_test(_means(runs), sharp.luminance, sharp.luminance_variance, block=BLOCK)


def block_scores(runs: Sequence[Run], reference: ReferenceImage) -> FloatArray:
    """Return the blocks' deviations, (h, w), as normal scores: the same for any number of runs."""
    test = block_test(runs, reference)
    tiny = np.finfo(np.float64).tiny
    scores = stats.norm.isf(0.5 * np.maximum(test.p_values, tiny))
    return np.asarray((np.sign(test.statistic) * scores)[..., 0])


def block_biases(data: Measured, numbers: Sequence[Number]) -> Iterator[Row]:
    """
    Blocks of pixels whose mean luminance differs from the reference's, and a test of all together.

    Of blocks without a bias 5 % differ. The p-value of all, a row of its own, is that of the most
    different block, corrected for their number: heavy tails make it small as well.
    """
    share, p_value = numbers
    reference = reference_of(data)
    for name, runs in data.runs.items():
        if len(runs) < LEAST_RUNS:
            continue
        test = block_test(runs, reference)
        yield make_row(data, name, share, lone(float(np.mean(test.p_values < _LEVEL))))
        yield make_row(data, name, p_value, lone(test.p_value))


def pixel_biases(data: Measured, numbers: Sequence[Number]) -> Iterator[Row | Refused]:
    """
    Root mean square of the relative bias of single pixels, by products of independent runs.

    Against the reference, whose own error is subtracted, and (where the baseline is unbiased, far
    more surely) against the baseline on the same frames.
    """
    found = shares(data, means_of(data), relative)
    yield from unless_noisy(data, numbers[0].name, found, _pixel_biases(data, *numbers))


def _pixel_biases(data: Measured, plain: Number, against_baseline: Number) -> Iterator[Row]:
    reference = reference_of(data)
    truth, variance = reference.luminance, reference.luminance_variance
    means = {name: _means(runs) for name, runs in data.runs.items() if len(runs) > 1}
    found = {name: squared_pixel_bias(own, truth, variance) for name, own in means.items()}
    for name, own in found.items():
        partner = data.partner(name)
        p_value = own.minus(found[partner]).p_value() if partner else None
        yield make_row(data, name, plain, _root(own.interval()), None, p_value)
        if partner:
            # The squared bias of the difference: what both have of the reference cancels.
            paired = squared_pixel_bias(means[name] - means[partner] + truth, truth)
            root = _root(paired.interval())
            yield make_row(data, name, against_baseline, root, None, paired.p_value())


def _means(runs: Sequence[Run]) -> FloatArray:
    """Luminance of the mean of the frames of every run, (K, H, W)."""
    return np.stack([luminance(run.mean) for run in runs])


def _root(squared: Interval) -> Interval:
    """Root of an interval of squares; a negative square is a bias that was not seen."""
    low, value, high = np.sqrt(np.maximum([squared.low, squared.value, squared.high], 0.0))
    error = squared.standard_error / (2.0 * value) if value > 0.0 else float("nan")
    return Interval(float(value), float(low), float(high), float(error), squared.level)
