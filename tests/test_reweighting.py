"""No unbiased choice among estimates has less error power than their mean, at any frequency."""

from __future__ import annotations

import numpy as np
import pytest
from reweighting import (
    UNBIASED,
    Powers,
    biased_in_turn,
    choice_powers,
    masked_choice,
    reweighted,
)
from scipy import stats
from support.bias import sidak

from mitsuba_restir.analysis.spectrum import band_power
from mitsuba_restir.sampling.masks import load_mask, mask_values

ALPHA = 1e-4
"""False-alarm rate of a test (the seeds are fixed)."""

BANDS = ((0.0, 0.06), (0.06, 0.17), (0.17, 0.25), (0.25, 0.5))
REALISATIONS = 64


@pytest.fixture(scope="module")
def mask() -> np.ndarray:
    return mask_values(load_mask(size=64))


def powers(rule, mask) -> Powers:
    return choice_powers(rule, mask, estimates=4, realisations=REALISATIONS, seed=1)


def score(differences: np.ndarray) -> np.ndarray:
    """Student's t of the mean of independent differences (n, ...)."""
    error = differences.std(axis=0, ddof=1) / np.sqrt(len(differences))
    return differences.mean(axis=0) / error


def threshold(tests: int) -> float:
    return float(stats.t.isf(sidak(ALPHA, tests) / 2, REALISATIONS - 1))


def test_a_reweighted_choice_is_unbiased_given_the_estimates():
    """Over all values of the random number, exactly the mean."""
    rng = np.random.default_rng(0)
    estimates, p = rng.random((2, 5, 1, 40)) + 0.05
    p = p / p.sum(axis=0)
    u = (np.arange(20_000) + 0.5)[:, None] / 20_000
    shown = reweighted(
        np.broadcast_to(estimates, (5, 20_000, 40)), np.broadcast_to(p, (5, 20_000, 40)), u
    )
    # Each of the 4 steps is off by at most half a cell of u.
    np.testing.assert_allclose(shown.mean(axis=0), estimates.mean(axis=0)[0], rtol=2e-3)


def test_the_masked_choice_takes_every_rank_equally_often(mask):
    """Its random offset makes the mask's value at a pixel uniform: the mean is the estimates'."""
    rng = np.random.default_rng(3)
    estimates = np.exp(rng.standard_normal((4, 64, 64)))
    shown = np.stack([masked_choice(estimates, mask, rng) for _ in range(400)])
    t = score(shown - estimates.mean(axis=0))
    assert abs(t).max() < stats.t.isf(sidak(ALPHA, t.size) / 2, 399)


@pytest.mark.parametrize("name", UNBIASED)
def test_no_unbiased_choice_has_less_power_than_the_mean(mask, name):
    found = powers(UNBIASED[name], mask)
    shown, mean, added = (band_power(p, BANDS) for p in (found.shown, found.mean, found.added))
    # What the choice adds is uncorrelated with the mean, so that the powers add up...
    assert abs(score(shown - mean - added)).max() < threshold(len(BANDS))
    # ... and it has power in every band.
    assert score(shown - mean).min() > threshold(len(BANDS))
    # At single frequencies, the constant left out, it is at least nowhere less.
    t = score((found.shown - found.mean).reshape(REALISATIONS, -1)[:, 1:])
    assert t.min() > -threshold(t.size)


def test_values_in_the_probabilities_add_more_power_than_chance(mask):
    """A choice that reads values pays for its uneven weights."""
    uniform = band_power(powers(UNBIASED["uniform"], mask).added, BANDS)
    for name in ("unlike the neighbours", "in turn"):
        steered = band_power(powers(UNBIASED[name], mask).added, BANDS)
        assert score(steered - uniform).min() > threshold(len(BANDS)), name


def test_control_a_biased_choice_has_less(mask):
    """Without the weight the same steering wins: what the theorem excludes is seen where it is."""
    found = powers(biased_in_turn, mask)
    ratio = band_power(found.shown, BANDS).mean(axis=0) / band_power(found.mean, BANDS).mean(axis=0)
    assert ratio.max() < 0.6
    with pytest.raises(AssertionError):
        assert score(band_power(found.shown - found.mean, BANDS)).min() > threshold(len(BANDS))
