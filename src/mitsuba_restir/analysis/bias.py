"""Statistical tests of unbiasedness: independent runs against a reference of known variance.

The mean of B runs is compared with the reference by Student's t, in units of different size: single
pixels (local errors), blocks of pixels (far more power against smooth errors, and far closer to
Gaussian), and whole channels (the most power against a change of the mean). The critical value is
Sidak-corrected, so the false-alarm rate of a whole test is the stated alpha.

Heavy tails. Light transport has pixels that are dark in most runs and very bright in a few. Their
t-statistic is far from Student's: where the bright runs have not happened yet both the mean and its
estimated error are too small, and plain pixel tests raise false alarms on nearly every image. Three
rules answer this. Average the runs into 8 to 16 batches first (`batch_means`), so that what is
tested is closer to Gaussian and the critical value of few degrees of freedom is wide. In pixel
tests, the variance is at least half its mean over the 5x5 window: neighbours have seen the bright
runs. And the conclusive tests are those of blocks and channels, where the central limit theorem
holds. Variances of blocks are estimated between runs, so the correlation of pixels inside a run is
accounted for.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage, stats

from .bias_report import BiasReport, BiasTest
from .images import FloatArray, finite, variance_like
from .power import detectable_error, sidak
from .units import batch_means, block_sums

__all__ = ["BiasReport", "BiasTest", "batch_means", "mean_test", "unbiasedness_test"]

_WINDOW = 5
_LOCAL_SHARE = 0.5


def mean_test(
    runs: ArrayLike,
    reference: ArrayLike,
    reference_variance: ArrayLike = 0.0,
    *,
    block: int | None = 1,
    alpha: float = 0.01,
    reference_batches: int | None = None,
    floor: float = 1e-4,
) -> BiasTest:
    """
    Test that the mean of independent runs equals a reference, in every block and channel.

    t = (mean - R) / sqrt(s²/B + Var R), with Welch's degrees of freedom (B - 1 where the reference
    is exact).

    Parameters
    ----------
    runs : array_like, (B, H, W) or (B, H, W, C)
        Independent runs or, better, means of batches of them (see the module's notes).
    reference : array_like, (H, W) or (H, W, C)
        The expectation, or an independent estimate of it.
    reference_variance : array_like
        Variance of each value of the reference (of its mean), or a number. Pixels of the reference
        are taken as independent, as those of a path tracer with a box filter are: give a reference
        that is smoothed for other ends as it was before.
    block : int or None
        Side of a unit in pixels; 1 tests pixels, None the mean of each channel.
    alpha : float
        False-alarm rate of the whole test.
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
    difference = unit.mean(axis=0) - target
    t = difference / error
    p = 2.0 * stats.t.sf(np.abs(t), freedom)
    each = sidak(alpha, t.size)
    threshold = stats.t.isf(0.5 * each, freedom)
    relative = np.divide(difference, scale, out=np.zeros_like(scale), where=scale > 0.0)
    # Units whose variance happened to come out small would promise a power that is not there.
    typical = np.maximum(np.sqrt(np.maximum(own, nearby) + known), least)
    detectable = detectable_error(target, typical, threshold, freedom)
    return BiasTest(block, count, t, p, relative, alpha, each, detectable)


def unbiasedness_test(
    runs: ArrayLike,
    reference: ArrayLike,
    reference_variance: ArrayLike = 0.0,
    *,
    blocks: tuple[int | None, ...] = (1, 8, None),
    alpha: float = 0.01,
    reference_batches: int | None = None,
    floor: float = 1e-4,
) -> BiasReport:
    """
    Pixel, block and channel tests together, with one stated false-alarm rate.

    Parameters
    ----------
    runs, reference, reference_variance, reference_batches, floor
        As in `mean_test`.
    blocks : tuple of int or None
        Sides of the units of each family.
    alpha : float
        Probability that an unbiased image fails, over all families.
    """
    each = sidak(alpha, len(blocks))
    tests = tuple(
        mean_test(
            runs,
            reference,
            reference_variance,
            block=block,
            alpha=each,
            reference_batches=reference_batches,
            floor=floor,
        )
        for block in blocks
    )
    x, r, _ = _operands(runs, reference, reference_variance)
    return BiasReport(tests, alpha, x.mean(axis=0), r)


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
