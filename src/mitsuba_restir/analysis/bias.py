"""Tests of the mean of independent runs against a reference of known variance.

Student's t in units of different size: single pixels (local errors), blocks of pixels (far more
power against smooth errors, and far closer to Gaussian), and whole channels (the most power against
a change of the mean).

Heavy tails. Light transport has pixels that are dark in most runs and very bright in a few. Their
t-statistic is far from Student's: where the bright runs have not happened yet both the mean and
its estimated error are too small, and plain pixel tests raise false alarms on nearly every image.
So the variance of a pixel is at least half its mean over the 5x5 window: neighbours have seen the
bright runs. The conclusive tests are those of blocks and channels, where the central limit theorem
holds. Variances of blocks are estimated between runs, so the correlation of pixels inside a run is
accounted for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage, stats

from .images import FloatArray, finite, variance_like

__all__ = ["MeanTest", "mean_test"]

_WINDOW = 5
_LOCAL_SHARE = 0.5


@dataclass(frozen=True)
class MeanTest:
    """
    t-tests of units of one size.

    Fields
    ------
    difference, scale : ndarray, (h, w, C)
        Mean of the runs minus reference, and what it is relative to: the reference plus 1 % of the
        image's mean.
    error, freedom : ndarray, (h, w, C)
        Standard error of the difference, and its degrees of freedom.
    typical_error : ndarray, (h, w, C)
        The same where it is larger in the neighbourhood: units whose variance happened to come out
        small would promise a power that is not there.
    target : ndarray, (h, w, C)
        The reference.
    """

    difference: FloatArray
    scale: FloatArray
    error: FloatArray
    freedom: FloatArray
    typical_error: FloatArray
    target: FloatArray

    @property
    def statistic(self) -> FloatArray:
        """Student's t of each unit and channel."""
        return self.difference / self.error

    @property
    def p_values(self) -> FloatArray:
        """Two-sided p-value of each unit and channel."""
        return np.asarray(2.0 * stats.t.sf(np.abs(self.statistic), self.freedom))

    @property
    def p_value(self) -> float:
        """p-value of all units together: how probable their smallest is without a bias."""
        smallest = min(self.p_values.min(), 1 - 1e-16)
        return float(-np.expm1(self.p_values.size * np.log1p(-smallest)))


def mean_test(
    runs: ArrayLike,
    reference: ArrayLike,
    reference_variance: ArrayLike = 0.0,
    *,
    block: int | None = 1,
    reference_batches: int | None = None,
    floor: float = 1e-4,
) -> MeanTest:
    """
    Test that the mean of independent runs equals a reference, in every block and channel.

    t = (mean - R) / sqrt(s²/B + Var R), with Welch's degrees of freedom (B - 1 where the reference
    is exact).

    Parameters
    ----------
    runs : array_like, (B, H, W) or (B, H, W, C)
        Independent runs or, better, means of batches of them, which are closer to Gaussian.
    reference : array_like, (H, W) or (H, W, C)
        The expectation, or an independent estimate of it.
    reference_variance : array_like
        Variance of each value of the reference (of its mean), or a number. Pixels of the reference
        are taken as independent, as those of a path tracer with a box filter are: give a reference
        that is smoothed for other ends as it was before.
    block : int or None
        Side of a unit in pixels; 1 tests pixels, None the mean of each channel.
    reference_batches : int, optional
        Number of batches from which the reference's variance was estimated; by default it counts as
        known.
    floor : float
        Standard errors are at least this share of the value (plus 1 % of the image's mean), so that
        rounding in pixels without noise is no bias.

    Raises
    ------
    ValueError
        If shapes do not fit, values are not finite, or there are fewer than 2 runs.
    """
    x, r, variance = _operands(runs, reference, reference_variance)
    count = x.shape[0]
    (sums, pixels), r_sums = block_sums(x, block), block_sums(r, block)[0]
    unit, target = sums / pixels, r_sums / pixels
    own = unit.var(axis=0, ddof=1) / count
    nearby = ndimage.uniform_filter(own, (_WINDOW, _WINDOW, 1), mode="nearest")
    if block == 1:
        own = np.maximum(own, _LOCAL_SHARE * nearby)
    known = block_sums(variance, block)[0] / pixels**2
    scale = np.abs(target) + 0.01 * float(np.abs(r).mean())
    # Never zero, also where the whole image and its reference are black.
    least = np.maximum(floor * scale, 1e-30)
    error = np.maximum(np.sqrt(own + known), least)
    freedom = _welch(own, known, count, reference_batches)
    typical = np.maximum(np.sqrt(np.maximum(own, nearby) + known), least)
    return MeanTest(unit.mean(axis=0) - target, scale, error, freedom, typical, target)


def _operands(
    runs: ArrayLike, reference: ArrayLike, reference_variance: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    r = finite(reference, "The reference", (2, 3))
    x = finite(runs, "The stack of runs", (3, 4))
    if x.shape[1:] != r.shape:
        raise ValueError(f"Runs have shape {x.shape[1:]} but the reference has {r.shape}.")
    if x.shape[0] < 2:
        raise ValueError("A test needs at least 2 independent runs.")
    variance = np.broadcast_to(variance_like(reference_variance, r.shape), r.shape)
    if r.ndim == 2:
        x, r, variance = x[..., None], r[..., None], variance[..., None]
    return x, r, variance


def _welch(
    own: FloatArray, known: FloatArray, runs: int, reference_batches: int | None
) -> FloatArray:
    """Degrees of freedom of own + known (Welch 1947); a known variance has infinitely many."""
    below = own**2 / (runs - 1)
    if reference_batches is not None:
        below = below + known**2 / (reference_batches - 1)
    total = (own + known) ** 2
    # More than a million cannot be told from a Gaussian, and keeps t.sf in its accurate range.
    ratio = np.divide(total, below, out=np.full_like(total, 1e6), where=below > 0.0)
    return np.clip(ratio, 1.0, 1e6)


def block_sums(image: FloatArray, block: int | None) -> tuple[FloatArray, FloatArray]:
    """
    Sums over blocks of pixels; the last row and column of blocks may be smaller.

    Parameters
    ----------
    image : ndarray, (..., H, W, C)
    block : int or None
        Side in pixels; None is the whole image.

    Returns
    -------
    sums : ndarray, (..., h, w, C)
    counts : ndarray, (h, w, 1)
        Pixels in each block.
    """
    height, width = image.shape[-3:-1]
    step = max(height, width) if block is None else block
    rows, columns = np.arange(0, height, step), np.arange(0, width, step)
    sums = np.add.reduceat(np.add.reduceat(image, rows, axis=-3), columns, axis=-2)
    counts = np.outer(np.diff([*rows, height]), np.diff([*columns, width]))
    return sums, counts[..., None].astype(np.float64)
