"""What a test of bias found: families of t-tests, their report, and the images of a failure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .images import FloatArray


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
