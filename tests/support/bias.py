"""Statistical tests of unbiasedness: families of t-tests, their false-alarm rate and their power.

The mean of B runs is compared with the reference in pixels, blocks and channels
(`mitsuba_restir.analysis.bias`). The critical value is Sidak-corrected, so the false-alarm rate of
a whole test is the stated alpha. Average the runs into 8 to 16 batches first (`batch_means`), so
that what is tested is closer to Gaussian and the critical value of few degrees of freedom is wide.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize, special, stats

from mitsuba_restir.analysis import bias
from mitsuba_restir.analysis.images import FloatArray

# Beyond this many standard errors every unit is found; it only bounds the search.
_LARGEST_SHIFT = 1e6


@dataclass(frozen=True)
class BiasTest:
    """
    One family of t-tests.

    Fields
    ------
    block : int or None
        Side of a unit in pixels; None is the whole image.
    runs : int
        Number of independent runs (batches) used.
    statistic, p_values : ndarray, (h, w, C)
        t and its two-sided p-value for each unit and channel.
    relative_error : ndarray, (h, w, C)
        Mean minus reference, over the reference plus 1 % of the image's mean.
    alpha : float
        Probability that the whole family rejects an unbiased image.
    alpha_each : float
        The Sidak-corrected level of each unit.
    detectable : float
        Estimate of the smallest relative error, common to all values, that is found with
        probability 0.99.
    """

    block: int | None
    runs: int
    statistic: FloatArray
    p_values: FloatArray
    relative_error: FloatArray
    alpha: float
    alpha_each: float
    detectable: float

    @property
    def rejected(self) -> int:
        """Number of units whose p-value lies below the corrected level."""
        return int(np.count_nonzero(self.p_values < self.alpha_each))

    @property
    def p_value(self) -> float:
        """p-value of the family: how probable its smallest p-value is without a bias."""
        return float(-np.expm1(self.p_values.size * np.log1p(-min(self.p_values.min(), 1 - 1e-16))))

    @property
    def passed(self) -> bool:
        """No unit is rejected."""
        return self.rejected == 0

    def __str__(self) -> str:
        if self.block is None:
            units = "channel means"
        else:
            units = "pixels" if self.block == 1 else f"{self.block}x{self.block} blocks"
        worst = np.unravel_index(int(np.argmin(self.p_values)), self.p_values.shape)
        return (
            f"{'passed' if self.passed else 'FAILED'}: {units}, {self.rejected} of "
            f"{self.p_values.size} rejected, family p = {self.p_value:.2g}, worst t = "
            f"{self.statistic[worst]:+.1f} (error {self.relative_error[worst]:+.2%}) at "
            f"(row, column, channel) {tuple(int(i) for i in worst)}; finds "
            f"{self.detectable:.2%} with probability 0.99"
        )


@dataclass(frozen=True)
class BiasReport:
    """
    Pixel, block and channel tests of one image, with what is needed to look at a failure.

    Fields
    ------
    tests : tuple of BiasTest
        The families; their false-alarm rates are split so that `alpha` is that of all together.
    alpha : float
        Probability that an unbiased image fails.
    mean, reference : ndarray, (H, W, C)
        Mean of the runs, and what it is compared with.
    """

    tests: tuple[BiasTest, ...]
    alpha: float
    mean: FloatArray
    reference: FloatArray

    @property
    def passed(self) -> bool:
        """All families passed."""
        return all(test.passed for test in self.tests)

    @property
    def detectable(self) -> float:
        """Smallest relative error of the whole image found with probability 0.99 by some family."""
        return min(test.detectable for test in self.tests)

    def __str__(self) -> str:
        head = f"{'unbiased' if self.passed else 'BIASED'} at a false-alarm rate of {self.alpha:g}"
        return "\n".join([head, *(f"  {test}" for test in self.tests)])

    def images(self) -> dict[str, FloatArray]:
        """The mean, the reference, their difference, and t and p of every family."""
        found = {
            "image": self.mean,
            "reference": self.reference,
            "difference": self.mean - self.reference,
        }
        for test in self.tests:
            name = "mean" if test.block is None else f"block{test.block}"
            found[f"t_{name}"], found[f"p_{name}"] = test.statistic, test.p_values
        return found

    def write(
        self, path: str | Path, writer: Callable[[Path, FloatArray], None] | None = None
    ) -> None:
        """
        Write the images, to look at a failure.

        Parameters
        ----------
        path : path
            Without a writer, the `.npz` file; with one, a folder.
        writer : callable, optional
            Called with (folder / name, array) for every image; it adds its own suffix.
        """
        target = Path(path)
        if writer is None:
            target.parent.mkdir(parents=True, exist_ok=True)
            with target.open("wb") as file:
                np.savez_compressed(file, **self.images())  # type: ignore[arg-type]
            return
        target.mkdir(parents=True, exist_ok=True)
        for name, array in self.images().items():
            writer(target / name, array)


def mean_test(
    runs: ArrayLike,
    reference: ArrayLike,
    reference_variance: ArrayLike = 0.0,
    *,
    block: int | None = 1,
    alpha: float = 0.01,
    **options: Any,
) -> BiasTest:
    """
    Test that the mean of independent runs equals a reference, in every block and channel.

    Parameters
    ----------
    runs, reference, reference_variance, block, options
        As in `mitsuba_restir.analysis.bias.mean_test`.
    alpha : float
        False-alarm rate of the whole test.
    """
    found = bias.mean_test(runs, reference, reference_variance, block=block, **options)
    each = sidak(alpha, found.error.size)
    threshold = stats.t.isf(0.5 * each, found.freedom)
    relative = np.divide(
        found.difference, found.scale, out=np.zeros_like(found.scale), where=found.scale > 0.0
    )
    detectable = detectable_error(found.target, found.typical_error, threshold, found.freedom)
    count = len(np.asarray(runs))
    return BiasTest(
        block, count, found.statistic, found.p_values, relative, alpha, each, detectable
    )


def unbiasedness_test(
    runs: ArrayLike,
    reference: ArrayLike,
    reference_variance: ArrayLike = 0.0,
    *,
    blocks: tuple[int | None, ...] = (1, 8, None),
    alpha: float = 0.01,
    **options: Any,
) -> BiasReport:
    """
    Pixel, block and channel tests together, with one stated false-alarm rate.

    Parameters
    ----------
    runs, reference, reference_variance, options
        As in `mean_test`.
    blocks : tuple of int or None
        Sides of the units of each family.
    alpha : float
        Probability that an unbiased image fails, over all families.
    """
    each = sidak(alpha, len(blocks))
    tests = tuple(
        mean_test(runs, reference, reference_variance, block=block, alpha=each, **options)
        for block in blocks
    )
    mean, truth = np.mean(runs, axis=0, dtype=np.float64), np.asarray(reference, dtype=np.float64)
    return BiasReport(tests, alpha, *(np.atleast_3d(image) for image in (mean, truth)))


def batch_means(runs: Iterable[ArrayLike], size: int) -> FloatArray:
    """
    Average every `size` consecutive runs, without holding all of them.

    Parameters
    ----------
    runs : iterable of array_like
        Independent images of one shape; a generator is consumed one image at a time.
    size : int
        Runs in a batch.

    Returns
    -------
    ndarray, (B, ...)
        The batch means.

    Raises
    ------
    ValueError
        If the number of runs is no multiple of `size`.
    """
    if size < 1:
        raise ValueError(f"A batch needs at least one run, not {size}.")
    batches: list[FloatArray] = []
    count = 0
    for run in runs:
        image = np.asarray(run, dtype=np.float64)
        if count % size == 0:
            batches.append(np.zeros_like(image))
        batches[-1] += image / size
        count += 1
    if count == 0 or count % size:
        raise ValueError(f"{count} runs cannot be averaged into batches of {size}.")
    return np.stack(batches)


def sidak(alpha: float, tests: int) -> float:
    """
    Level of each of several tests that together raise a false alarm with probability alpha.

    Exact for independent tests, and an upper bound of the false-alarm rate for two-sided tests of
    correlated Gaussian means (Sidak 1967).
    """
    if not 0.0 < alpha < 1.0:
        raise ValueError(f"alpha must be in (0, 1), not {alpha}.")
    return float(-np.expm1(np.log1p(-alpha) / tests))


def miss_probability(shift: ArrayLike, threshold: ArrayLike, freedom: ArrayLike) -> FloatArray:
    """
    Probability that a t-test misses an error, P(T <= threshold), T noncentral Student.

    Abramowitz & Stegun 26.7.10. The other tail of a two-sided test is left out, which makes it an
    upper bound of the probability of missing.

    Parameters
    ----------
    shift : array_like
        The error in standard errors (noncentrality).
    threshold, freedom : array_like
        Critical value and degrees of freedom.
    """
    t, nu = np.asarray(threshold, dtype=np.float64), np.asarray(freedom, dtype=np.float64)
    z = (t * (1.0 - 0.25 / nu) - np.asarray(shift)) / np.sqrt(1.0 + 0.5 * t**2 / nu)
    return np.asarray(special.ndtr(z))


def detectable_error(
    value: ArrayLike,
    standard_error: ArrayLike,
    threshold: ArrayLike,
    freedom: ArrayLike,
    *,
    probability: float = 0.99,
) -> float:
    """
    Smallest relative error, common to all units, that at least one of their tests finds.

    Parameters
    ----------
    value, standard_error, threshold, freedom : array_like
        True value, standard error of the difference, critical value and degrees of freedom of each
        unit. Units are taken as independent.
    probability : float
        Probability of finding the error.

    Returns
    -------
    float
        Relative error, e.g. 0.01 for one per cent; infinite where all values are zero, and for
        hundreds of units of 4 runs, where `miss_probability` is too rough to promise anything.
    """
    shift = np.abs(np.asarray(value, dtype=np.float64)) / np.asarray(standard_error)
    strongest = float(shift.max())
    if not strongest > 0.0:
        return float("inf")
    goal = np.log1p(-probability)

    def excess(log_error: float) -> float:
        miss = miss_probability(np.exp(log_error) * shift, threshold, freedom)
        # The floor keeps log(0) away from units that are certain to be found.
        return float(np.log(np.maximum(miss, 1e-300)).sum() - goal)

    low, high = np.log(1e-6 / strongest), np.log(_LARGEST_SHIFT / strongest)
    if excess(low) <= 0.0:
        return float("inf")
    return float(np.exp(optimize.brentq(excess, low, high, xtol=1e-4)))
