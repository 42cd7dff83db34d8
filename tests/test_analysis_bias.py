"""The tests of bias are tested: false alarms, injected errors, heavy tails, stated bias."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from support import bias

from mitsuba_restir.analysis.bias import block_sums

SHAPE = (24, 32, 3)


def _reference(rng: np.random.Generator) -> np.ndarray:
    return 0.2 + rng.random(SHAPE)


def _runs(
    rng: np.random.Generator,
    reference: np.ndarray,
    count: int,
    kind: str = "normal",
    noise: float = 0.2,
) -> np.ndarray:
    shape = (count, *reference.shape)
    if kind == "normal":
        return reference * (1.0 + noise * rng.normal(size=shape))
    if kind == "lognormal":
        return reference * rng.lognormal(-0.5, 1.0, shape)
    # A path is found in one run of five, as in a room lit through a door slightly open.
    return reference * (rng.random(shape) < 0.2) / 0.2


@pytest.mark.parametrize("block", [1, 8, None])
def test_false_alarm_rate_of_one_family(block: int | None) -> None:
    rng = np.random.default_rng(1)
    failed = 0
    for _ in range(200):
        reference = _reference(rng)
        runs = _runs(rng, reference, 8)
        failed += not bias.mean_test(runs, reference, block=block, alpha=0.1).passed
    # The floor of the variance makes pixel tests conservative; the others keep alpha.
    assert failed <= stats.binom.isf(1e-4, 200, 0.1)
    if block != 1:
        assert failed >= stats.binom.isf(1 - 1e-4, 200, 0.1)


def test_false_alarm_rate_with_a_noisy_reference() -> None:
    rng = np.random.default_rng(2)
    failed = 0
    for _ in range(100):
        truth = _reference(rng)
        noise = 0.1 * truth
        reference = truth + noise * rng.normal(size=truth.shape)
        runs = _runs(rng, truth, 8)
        failed += not bias.unbiasedness_test(runs, reference, noise**2, alpha=0.1).passed
    assert failed <= stats.binom.isf(1e-4, 100, 0.1)


@pytest.mark.parametrize("kind", ["lognormal", "rare"])
def test_false_alarm_rate_with_heavy_tails(kind: str) -> None:
    rng = np.random.default_rng(3)
    failed = 0
    for _ in range(40):
        reference = _reference(rng)
        runs = bias.batch_means(_runs(rng, reference, 64, kind), 8)
        failed += not bias.unbiasedness_test(runs, reference, alpha=0.01).passed
    assert failed <= stats.binom.isf(1e-4, 40, 0.01)


def test_correlated_pixels_raise_no_alarm() -> None:
    rng = np.random.default_rng(4)
    failed = 0
    for _ in range(100):
        reference = _reference(rng)
        common = 1.0 + 0.3 * rng.normal(size=(8, 6, 8, 1)).repeat(4, axis=1).repeat(4, axis=2)
        failed += not bias.unbiasedness_test(reference * common, reference, alpha=0.1).passed
    assert failed <= stats.binom.isf(1e-4, 100, 0.1)


@pytest.mark.parametrize("error", [0.005, 0.01, 0.03, -0.01])
def test_an_injected_error_is_found_as_often_as_stated(error: float) -> None:
    rng = np.random.default_rng(5)
    found, promised = 0, 0.0
    for _ in range(30):
        reference = _reference(rng)
        runs = (1.0 + error) * _runs(rng, reference, 16, noise=0.05)
        report = bias.unbiasedness_test(runs, reference)
        found += not report.passed
        promised = max(promised, report.detectable)
    assert promised <= 0.005
    assert found == 30


def test_a_local_error_is_found_by_pixels_and_blocks() -> None:
    rng = np.random.default_rng(6)
    reference = _reference(rng)
    runs = _runs(rng, reference, 16)
    single = runs.copy()
    single[:, 5, 7, 1] *= 3.0
    report = bias.unbiasedness_test(single, reference)
    assert [test.passed for test in report.tests] == [False, True, True]
    pixels = report.tests[0]
    assert np.unravel_index(pixels.p_values.argmin(), SHAPE) == (5, 7, 1)
    assert pixels.rejected == 1
    edge = runs.copy()
    edge[:, 8:16, 8:16] *= 1.1
    assert not bias.mean_test(edge, reference, block=8).passed


def test_an_error_of_one_channel_is_found() -> None:
    rng = np.random.default_rng(7)
    reference = _reference(rng)
    runs = _runs(rng, reference, 16)
    runs[..., 2] *= 1.01
    test = bias.mean_test(runs, reference, block=None)
    assert not test.passed
    assert test.p_values[0, 0, 2] == test.p_values.min()
    assert min(test.p_values[0, 0, :2]) > test.alpha_each


def test_the_stated_power_holds() -> None:
    rng = np.random.default_rng(8)
    reference = _reference(rng)
    stated = bias.mean_test(_runs(rng, reference, 16), reference, block=8).detectable
    found = [
        not bias.mean_test((1 + stated) * _runs(rng, reference, 16), reference, block=8).passed
        for _ in range(100)
    ]
    assert sum(found) >= stats.binom.isf(1 - 1e-4, 100, 0.99) - 1
    small = [
        not bias.mean_test((1 + stated / 4) * _runs(rng, reference, 16), reference, block=8).passed
        for _ in range(30)
    ]
    assert sum(small) < 15


def test_t_and_p_against_scipy() -> None:
    rng = np.random.default_rng(9)
    reference = _reference(rng)
    runs = _runs(rng, reference, 10)
    test = bias.mean_test(runs, reference, block=None)
    expected = stats.ttest_1samp(runs.mean(axis=(1, 2)), reference.mean(axis=(0, 1)))
    np.testing.assert_allclose(test.statistic[0, 0], expected.statistic, rtol=1e-9)
    np.testing.assert_allclose(test.p_values[0, 0], expected.pvalue, rtol=1e-9)
    others = reference[..., 0] + 0.3 * rng.normal(size=(7, *SHAPE[:2]))
    block = runs[..., 0]
    welch = bias.mean_test(
        block,
        others.mean(axis=0),
        others.var(axis=0, ddof=1) / 7,
        block=1,
        reference_batches=7,
    )
    theirs = stats.ttest_ind(block, others, equal_var=False)
    # Pixels whose own variance exceeds the floor of their neighbourhood are plain Welch tests.
    plain = np.isclose(welch.statistic[..., 0], theirs.statistic, rtol=1e-9)
    assert plain.mean() > 0.5
    np.testing.assert_allclose(welch.p_values[plain, 0], theirs.pvalue[plain], rtol=1e-9)
    assert np.all(np.abs(welch.statistic[..., 0]) <= np.abs(theirs.statistic) * (1 + 1e-9))


@pytest.mark.parametrize("block", [1, 5, 8, None])
def test_block_sums_by_brute_force(block: int | None) -> None:
    rng = np.random.default_rng(10)
    image = rng.random((2, 13, 17, 3))
    sums, counts = block_sums(image, block)
    step = block or 17
    for row in range(sums.shape[1]):
        for column in range(sums.shape[2]):
            part = image[:, row * step : (row + 1) * step, column * step : (column + 1) * step]
            np.testing.assert_allclose(sums[:, row, column], part.sum(axis=(1, 2)))
            assert counts[row, column, 0] == part.shape[1] * part.shape[2]


def test_batch_means() -> None:
    rng = np.random.default_rng(11)
    runs = rng.random((12, 4, 5))
    expected = runs.reshape(3, 4, 4, 5).mean(axis=1)
    np.testing.assert_allclose(bias.batch_means((run for run in runs), 4), expected)
    with pytest.raises(ValueError, match="12 runs"):
        bias.batch_means(runs, 5)


def test_miss_probability_against_noncentral_t() -> None:
    for freedom in (7, 15, 60):
        threshold = stats.t.isf(5e-6, freedom)
        for shift in np.linspace(0.5, 3.0, 6) * threshold:
            expected = stats.nct.cdf(threshold, freedom, shift)
            found = bias.miss_probability(shift, threshold, freedom)
            assert found == pytest.approx(expected, abs=0.03)


def test_many_units_of_few_runs_can_be_tested() -> None:
    runs = 1.0 + 0.1 * np.random.default_rng(20).standard_normal((4, 256, 256))
    test = bias.mean_test(runs, np.ones((256, 256)), block=8)
    assert test.passed
    assert np.isinf(test.detectable)


def test_sidak() -> None:
    assert bias.sidak(0.01, 1) == pytest.approx(0.01)
    assert 1 - (1 - bias.sidak(0.01, 12345)) ** 12345 == pytest.approx(0.01)
    with pytest.raises(ValueError, match="alpha"):
        bias.sidak(0.0, 3)


def test_pixels_without_noise() -> None:
    reference = np.full((8, 8, 3), 0.7)
    runs = np.broadcast_to(reference.astype(np.float32), (4, 8, 8, 3)).astype(np.float64)
    assert bias.unbiasedness_test(runs, reference).passed
    assert not bias.unbiasedness_test(1.01 * runs, reference).passed
    black = np.zeros((8, 8))
    assert bias.unbiasedness_test(np.zeros((4, 8, 8)), black).passed
    assert not bias.unbiasedness_test(np.full((4, 8, 8), 1e-3), black).passed


def test_failure_images(tmp_path: Path) -> None:
    rng = np.random.default_rng(12)
    reference = _reference(rng)
    report = bias.unbiasedness_test(1.1 * _runs(rng, reference, 8), reference)
    assert "BIASED" in str(report)
    assert "probability 0.99" in str(report)
    report.write(tmp_path / "deep" / "failure.npz")
    with np.load(tmp_path / "deep" / "failure.npz") as file:
        assert set(file) == set(report.images())
        np.testing.assert_array_equal(file["p_block1"], report.tests[0].p_values)
    written: list[str] = []
    report.write(tmp_path / "images", lambda path, array: written.append(path.name))
    assert written == list(report.images())


@pytest.mark.parametrize(
    ("runs", "reference", "variance", "message"),
    [
        (np.ones((4, 8, 8)), np.ones((8, 9)), 0.0, r"\(8, 8\).*\(8, 9\)"),
        (np.ones((1, 8, 8)), np.ones((8, 8)), 0.0, "at least 2"),
        (np.full((4, 8, 8), np.inf), np.ones((8, 8)), 0.0, "256 values"),
        (np.ones((4, 8, 8)), np.ones((8, 8)), -1.0, "negative"),
        (np.ones((4, 8, 8)), np.ones((8, 8)), np.ones((4, 4)), "variance has shape"),
    ],
)
def test_bad_input(
    runs: np.ndarray, reference: np.ndarray, variance: np.ndarray | float, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        bias.unbiasedness_test(runs, reference, variance)
