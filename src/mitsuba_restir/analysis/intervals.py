"""How sure a number is: Student's and jackknife intervals over runs, paired tests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from .images import FloatArray, finite

__all__ = [
    "Interval",
    "Jackknife",
    "jackknife",
    "mean_interval",
    "ratio_interval",
    "sign_flip_p_value",
]

Statistic = Callable[[FloatArray], float]


@dataclass(frozen=True)
class Interval:
    """
    A value with its confidence interval.

    Fields
    ------
    value : float
        The estimate from all runs.
    low, high : float
        Ends of the interval.
    standard_error : float
        Standard error of the value.
    level : float
        Coverage aimed at, e.g. 0.95.
    """

    value: float
    low: float
    high: float
    standard_error: float
    level: float = 0.95

    def __str__(self) -> str:
        return f"{self.value:.4g} [{self.low:.4g}, {self.high:.4g}]"


@dataclass(frozen=True)
class Jackknife:
    """
    A statistic of K runs, and of all of them but each one.

    With Student's quantile its intervals hold their coverage at the 8 to 10 runs that are usual
    here, where those of the bootstrap are too short.

    Fields
    ------
    value : float
        Of all runs.
    left_out : ndarray, (K,)
        Of all runs but run k; NaN where so few do not define it.
    """

    value: float
    left_out: FloatArray

    @property
    def standard_error(self) -> float:
        """Standard error of the value."""
        return _jackknife_error(self.left_out)

    @property
    def is_positive(self) -> bool:
        """Positive, whichever run is left out."""
        return bool(self.value > 0.0 and self.left_out.min() > 0.0)

    def log(self) -> Jackknife:
        """Return the logarithm."""
        return Jackknife(float(np.log(self.value)), np.log(self.left_out))

    def minus(self, other: Jackknife) -> Jackknife:
        """Return the difference from another statistic of the same runs."""
        return Jackknife(self.value - other.value, self.left_out - other.left_out)

    def interval(self, *, level: float = 0.95) -> Interval:
        """Return Student's interval."""
        error = self.standard_error
        half = _quantile(level, self.left_out.size) * error
        return Interval(self.value, self.value - half, self.value + half, error, level)

    def over(self, other: Jackknife, *, level: float = 0.95) -> Interval:
        """
        Return the ratio to another statistic of the same runs, with an interval of its logarithm.

        Of the ratio itself where one of the two may be negative. The interval is Student's.

        Raises
        ------
        ValueError
            If the numbers of runs differ.
        """
        if self.left_out.size != other.left_out.size:
            runs = self.left_out.size, other.left_out.size
            raise ValueError(f"Paired variants need equal numbers of runs, not {runs}.")
        if other.value == 0.0:
            nan = float("nan")
            return Interval(nan, nan, nan, nan, level)
        ratio = self.value / other.value
        logarithmic = self.is_positive and other.is_positive
        if logarithmic:
            above, below = np.log(self.left_out), -np.log(other.left_out)
        else:
            above, below = self.left_out / other.value, -ratio * other.left_out / other.value
        error = _jackknife_error(above + below)
        half = _quantile(level, above.size) * error
        if not logarithmic:
            return Interval(ratio, ratio - half, ratio + half, error, level)
        low, high = ratio * np.exp(-half), ratio * np.exp(half)
        return Interval(ratio, float(low), float(high), ratio * error, level)

    def p_value(self) -> float | None:
        """Return Student's two-sided p-value of zero; None where there is no error."""
        error = self.standard_error
        if not error > 0.0:
            return None
        return float(2.0 * stats.t.sf(abs(self.value) / error, self.left_out.size - 1))

    def p_value_against(self, other: Jackknife) -> float | None:
        """Return the p-value of no difference from another statistic, as `over` compares them."""
        if self.is_positive and other.is_positive:
            return self.log().minus(other.log()).p_value()
        return self.minus(other).p_value()


def _jackknife_error(left_out: FloatArray) -> float:
    n = left_out.size
    return float(np.sqrt((n - 1) / n * np.sum((left_out - left_out.mean()) ** 2)))


def _quantile(level: float, runs: int) -> float:
    """Student's quantile of a two-sided interval."""
    return float(stats.t.isf((1.0 - level) / 2.0, runs - 1))


def _runs(values: ArrayLike, name: str = "The values", least: int = 2) -> FloatArray:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0 or array.shape[0] < least:
        count = array.shape[0] if array.ndim else 0
        raise ValueError(f"{name} come from {count} runs: an interval needs at least {least}.")
    return finite(array, name, (array.ndim,))


def _pair(first: ArrayLike, second: ArrayLike) -> tuple[FloatArray, FloatArray]:
    a, b = _runs(first, "The first values"), _runs(second, "The second values")
    if a.shape != b.shape or a.ndim != 1:
        raise ValueError(f"Paired values need one shape (K,), not {a.shape} and {b.shape}.")
    return a, b


def mean_interval(values: ArrayLike, *, level: float = 0.95) -> Interval:
    """
    Mean over runs with Student's interval.

    Parameters
    ----------
    values : array_like, (K,)
        One number of each independent run.
    level : float
        Coverage.
    """
    a = _runs(values)
    error = float(a.std(ddof=1) / np.sqrt(a.size))
    half = _quantile(level, a.size) * error
    mean = float(a.mean())
    return Interval(mean, mean - half, mean + half, error, level)


def with_known_error(mean: Interval, runs: int, error: float) -> Interval:
    """
    Widen the interval of a mean over runs by another error that is known.

    Parameters
    ----------
    mean : Interval
        Of `mean_interval`.
    runs : int
        Of the mean.
    error : float
        A standard error, independent of the runs; with Welch's degrees of freedom.
    """
    if error == 0.0:
        return mean
    total = float(np.hypot(mean.standard_error, error))
    freedom = (runs - 1) * (total / max(mean.standard_error, 1e-3 * total)) ** 4
    half = float(stats.t.isf((1.0 - mean.level) / 2.0, freedom)) * total
    return Interval(mean.value, mean.value - half, mean.value + half, total, mean.level)


def ratio_interval(first: ArrayLike, second: ArrayLike, *, level: float = 0.95) -> Interval:
    """
    Ratio of two means, mean(first) / mean(second), with a jackknife interval of its logarithm.

    Parameters
    ----------
    first, second : array_like, (K,)
        Values of the same K runs, with positive means.

    Raises
    ------
    ValueError
        If a mean, over all runs or all but one, is not positive.
    """
    a, b = _pair(first, second)
    own, base = _mean_and_left_out(a), _mean_and_left_out(b)
    if not (own.is_positive and base.is_positive):
        raise ValueError("A ratio needs positive means over all runs and over all but any one.")
    return own.over(base, level=level)


def _mean_and_left_out(values: FloatArray) -> Jackknife:
    return Jackknife(float(values.mean()), (values.sum() - values) / (values.size - 1))


def jackknife(values: ArrayLike, statistic: Statistic) -> Jackknife:
    """
    Compute a smooth statistic of all runs, and of all but each one.

    Parameters
    ----------
    values : array_like, (K, ...)
        One entry of each independent run.
    statistic : callable
        Maps values (K', ...) to a number.
    """
    a = _runs(values)
    left_out = [statistic(np.delete(a, k, axis=0)) for k in range(a.shape[0])]
    return Jackknife(float(statistic(a)), np.array(left_out, dtype=np.float64))


def sign_flip_p_value(first: ArrayLike, second: ArrayLike, *, seed: int = 0) -> float:
    """
    Test that two variants do not differ over common runs, by sign flips: the two-sided p-value.

    All that is assumed is symmetry where there is no difference.

    Parameters
    ----------
    first, second : array_like, (K,)
        Entry k of both comes from the same run (seed) k.
    seed : int
        Fixes the sign flips, of which at most 9999 are drawn (all of them where 2^K is smaller).
    """
    a, b = _pair(first, second)
    test = stats.permutation_test(
        (a - b,),
        lambda d, axis: np.mean(d, axis=axis),
        permutation_type="samples",
        n_resamples=9999,
        vectorized=True,
        rng=np.random.default_rng(seed),
    )
    return float(test.pvalue)
