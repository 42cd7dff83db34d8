"""Reservoirs select in proportion to the weights, alone and merged."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from scipy import stats

from mitsuba_restir.paths.record import Form, empty_record
from mitsuba_restir.resampling.mis import density, share
from mitsuba_restir.resampling.reservoir import Streaming, empty_streaming, finalize, offer
from mitsuba_restir.sampling import streams

LANES = 1 << 17
FORM = Form(continued=False, compact=True)
WEIGHTS = (0.5, 0.0, 2.0, 1.0, 0.25, 4.0)


def uniform(vertex: int) -> mi.Float:
    key = streams.FrameKey(mi.UInt32(0), mi.UInt32(0))
    stream = key.stream(9, dr.arange(mi.UInt32, LANES))
    return streams.uniform2(stream, vertex, 0)[0]


def labelled(label: int):
    record = empty_record(FORM)
    record.info = mi.UInt32(label)
    return record


def streamed(weights, first: int = 0) -> Streaming:
    """Candidates with luminance w and label 0, 1, ..., each offered with its weight w."""
    reservoir = empty_streaming(FORM)
    for i, weight in enumerate(weights):
        reservoir = offer(
            reservoir,
            labelled(first + i),
            mi.Color3f(weight),
            mi.Float(weight),
            uniform(first + i),
            mi.Bool(True),
        )
    return reservoir


def test_selection_frequencies(rgb):
    reservoir = streamed(WEIGHTS)
    labels = np.array(reservoir.path.info)
    observed = np.bincount(labels, minlength=len(WEIGHTS))
    expected = LANES * np.array(WEIGHTS) / sum(WEIGHTS)
    assert observed[1] == 0
    chosen = expected > 0
    assert stats.chisquare(observed[chosen], expected[chosen]).pvalue > 1e-4
    np.testing.assert_allclose(np.array(reservoir.total), sum(WEIGHTS), rtol=1e-6)


def test_contribution_weight(rgb):
    count = len(WEIGHTS)
    reservoir = finalize(streamed(WEIGHTS), count, mi.Float(count))
    color, weight = np.array(reservoir.color)[0], np.array(reservoir.weight)
    # Luminance times weight is the mean resampling weight, whichever candidate was selected.
    np.testing.assert_allclose(color * weight, sum(WEIGHTS) / count, rtol=1e-5)


def test_merging_equals_streaming(rgb):
    """Two reservoirs merged by their sums select as one that saw all candidates."""
    halves = [streamed(WEIGHTS[:3]), streamed(WEIGHTS[3:], first=3)]
    merged = empty_streaming(FORM)
    for i, half in enumerate(halves):
        merged = offer(merged, half.path, half.color, half.total, uniform(20 + i), mi.Bool(True))
    observed = np.bincount(np.array(merged.path.info), minlength=len(WEIGHTS))
    expected = LANES * np.array(WEIGHTS) / sum(WEIGHTS)
    chosen = expected > 0
    assert stats.chisquare(observed[chosen], expected[chosen]).pvalue > 1e-4
    np.testing.assert_allclose(np.array(merged.total), sum(WEIGHTS), rtol=1e-6)


@pytest.mark.parametrize("weight", [np.nan, -1.0, 0.0])
def test_what_is_no_weight_is_no_candidate(rgb, weight):
    before = streamed(WEIGHTS)
    after = offer(before, labelled(9), mi.Color3f(1), mi.Float(weight), uniform(9), mi.Bool(True))
    assert not np.any(np.array(after.path.info) == 9)
    np.testing.assert_array_equal(np.array(after.total), np.array(before.total))


def test_inactive_lanes_keep_their_sample(rgb):
    active = dr.arange(mi.UInt32, LANES) % 2 == 0
    after = offer(streamed(WEIGHTS), labelled(9), mi.Color3f(1), mi.Float(1e9), uniform(9), active)
    taken = np.array(after.path.info) == 9
    assert np.mean(taken[::2]) > 0.999
    assert not taken[1::2].any()


def test_empty_reservoir_has_no_weight(rgb):
    assert np.all(np.array(finalize(empty_streaming(FORM), 1, mi.Float(1)).weight) == 0)


def test_balance_weights_are_a_partition(rgb):
    """Talbot: at any sample, the weights of the current and the previous technique sum to one."""
    rng = np.random.default_rng(1)
    current, previous = (mi.Float(10.0 ** rng.uniform(-6, 6, 1000)) for _ in range(2))
    jacobian = mi.Float(10.0 ** rng.uniform(-3, 3, 1000))
    # The same density as seen by both formulas: c p |J| at x, c p / (1/J) at its image.
    there = density(mi.Float(4), previous, jacobian)
    here = density(mi.Float(1), current, 1.0)
    np.testing.assert_allclose(np.array(share(here, there) + share(there, here)), 1, rtol=1e-6)


def test_weights_of_impossible_samples_vanish(rgb):
    assert share(mi.Float(0), mi.Float(0))[0] == 0
    assert share(mi.Float(1), mi.Float(0))[0] == 1
