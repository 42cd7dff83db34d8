"""Counter-based streams: uniform, and independent over everything that names a number."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from scipy import stats

from mitsuba_restir.sampling import streams
from mitsuba_restir.sampling.streams import FrameKey, PathName, Purpose

LANES = 1 << 16


def numbers(pixel=0, sample=0, seed=0, vertex=1, block=0, purpose=None) -> np.ndarray:
    """Both numbers of a block, (2, LANES); pass ``None`` for the one that counts the lanes."""
    lane = dr.arange(mi.UInt32, LANES)
    pixel, sample, seed, vertex = (
        lane if value is None else mi.UInt32(value) for value in (pixel, sample, seed, vertex)
    )
    if purpose is None:
        stream = PathName(pixel, sample, seed).stream()
    else:
        stream = FrameKey(sample, seed).stream(purpose, pixel)
    u, v = streams.uniform2(stream, vertex, block)
    return np.stack([np.broadcast_to(np.array(x), LANES) for x in (u, v)]).astype(np.float64)


AXES = [{axis: None} for axis in ("pixel", "sample", "seed", "vertex")]


@pytest.mark.parametrize("axis", AXES, ids=lambda a: next(iter(a)))
@pytest.mark.parametrize("purpose", [None, Purpose.SPATIAL])
def test_uniform(rgb, axis, purpose):
    u = numbers(**axis, purpose=purpose)
    assert u.min() >= 0
    assert u.max() < 1
    for row in u:
        assert stats.chisquare(np.histogram(row, 256, (0, 1))[0]).pvalue > 1e-4
    # Pairs fill the square; the low bits are as good as the high ones.
    pairs = np.histogram2d(u[0], u[1], 32, [(0, 1), (0, 1)])[0].ravel()
    assert stats.chisquare(pairs).pvalue > 1e-4
    low = np.histogram((u[0] * 2**16) % 1, 256, (0, 1))[0]
    assert stats.chisquare(low).pvalue > 1e-4


@pytest.mark.parametrize("axis", AXES, ids=lambda a: next(iter(a)))
def test_neighbouring_counters_are_independent(rgb, axis):
    u = numbers(**axis)[0]
    for lag in (1, 2, 3, 4, 16, 64, 256, 1024):
        correlation = np.corrcoef(u[:-lag], u[lag:])[0, 1]
        assert abs(correlation) < 5 / np.sqrt(LANES), lag
        square = np.histogram2d(u[:-lag], u[lag:], 16, [(0, 1), (0, 1)])[0].ravel()
        assert stats.chisquare(square).pvalue > 1e-5, lag


def test_names_do_not_share_numbers(rgb):
    """Vertices, blocks, samples, seeds and passes next to each other give unrelated numbers."""
    names = [{"pixel": None}]
    names += [{"pixel": None, "vertex": v} for v in (2, 3)]
    names += [{"pixel": None, "block": b} for b in (1, 2, 3)]
    names += [{"pixel": None, "sample": s} for s in (1, 2)]
    names += [{"pixel": None, "seed": s} for s in (1, 2)]
    names += [{"pixel": None, "purpose": p} for p in (1, 2, 3, 4)]
    rows = np.concatenate([numbers(**name) for name in names])
    correlation = np.corrcoef(rows) - np.eye(len(rows))
    assert np.abs(correlation).max() < 5.5 / np.sqrt(LANES)


def test_a_number_depends_on_its_name_alone(rgb):
    np.testing.assert_array_equal(numbers(pixel=None, vertex=3), numbers(pixel=None, vertex=3))
    lanes = numbers(pixel=None)
    np.testing.assert_array_equal(numbers(pixel=77)[:, 0], lanes[:, 77])


def test_a_decision_number_is_never_one(rgb):
    """Rounded to 1, it would not accept what is certain: a reservoir would lose its only path."""

    class Extreme(streams.Stream):
        def words(self, vertex, block):
            return self.x, self.y

    for word in (0, 0xFFFFFFFF):
        u = streams.uniform(Extreme(mi.UInt32(word), mi.UInt32(word)), 0, 0)
        assert 0 < u[0] < 1
        assert (u * mi.Float(3e-5))[0] < np.float32(3e-5)


def test_short_names_are_those_of_the_same_streams(rgb):
    """And no two running numbers of a seed, nor neighbouring seeds, have one in common."""
    lane = dr.arange(mi.UInt32, LANES)
    name = PathName(mi.UInt32(5), lane, mi.UInt32(11))
    for a, b in zip(
        streams.uniform2(name.stream(), 1, 0),
        streams.uniform2(name.short().stream(), 1, 0),
        strict=True,
    ):
        np.testing.assert_array_equal(np.array(a), np.array(b))
    by_sample = np.array(name.short().sample)
    by_seed = np.array(PathName(mi.UInt32(5), mi.UInt32(0), lane).short().sample)
    assert len(np.unique(by_sample)) == LANES
    # A pair in 2^32, of 2^31 pairs.
    assert len(np.unique(by_seed)) > LANES - 6
