"""What a family of t-tests can find: the smallest error seen with a stated probability."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize, special

from .images import FloatArray

# Beyond this many standard errors every unit is found; it only bounds the search.
_LARGEST_SHIFT = 1e6


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
