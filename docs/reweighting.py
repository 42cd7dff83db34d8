"""Why no unbiased choice among estimates makes an error blue: it only adds noise.

A pixel has k estimates g_1 ... g_k of its value, each unbiased. ReSTIR shows their mean. Whoever
chooses one of them with probability p_j, whatever p reads, and wants no bias must show

    I = g_j / (k p_j),     so that  I = mean + x  with  E[x | all estimates] = 0.

The covariance of I is then that of the mean plus that of x, which is positive semidefinite: at
every frequency the power of I is at least that of the mean, and what x has comes on top. A choice
can only win if it is biased given the estimates, or if it changes the estimates themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from mitsuba_restir.analysis.images import FloatArray
from mitsuba_restir.analysis.spectrum import power_spectrum
from mitsuba_restir.sampling.georgiev import SIGMA_I

Rule = Callable[[FloatArray, FloatArray, np.random.Generator], FloatArray]
"""A choice: (estimates (k, h, w), mask (h, w) in (0, 1), random numbers) -> shown image (h, w)."""

_DEFENSIVE = 0.3
"""Share of the uniform distribution in every probability, so that no weight exceeds 1/0.3."""

_TEMPERATURE = 0.05


def reweighted(
    estimates: npt.ArrayLike, probability: npt.ArrayLike, u: npt.ArrayLike
) -> FloatArray:
    """
    Choose an estimate of every pixel and weigh it so that the choice has no bias.

    Parameters
    ----------
    estimates : array_like, (k, ...)
    probability : array_like, (k, ...)
        Of each estimate, positive; they sum to 1.
    u : array_like, (...)
        Uniform numbers in [0, 1) that `probability` has not read.

    Returns
    -------
    array, (...)
        g_j / (k p_j).
    """
    g, p = np.asarray(estimates, dtype=np.float64), np.asarray(probability, dtype=np.float64)
    steps = np.cumsum(p, axis=0)[:-1]
    chosen = np.sum(np.asarray(u) >= steps, axis=0)[None]
    picked, chance = (np.take_along_axis(a, chosen, axis=0)[0] for a in (g, p))
    return np.asarray(picked / (len(g) * chance))


def uniform_choice(estimates: FloatArray, mask: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Each estimate with equal probability."""
    return reweighted(estimates, _uniform(estimates), rng.random(mask.shape))


def masked_choice(estimates: FloatArray, mask: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Sorted estimates, and the uniform number from a mask, shifted and offset at random."""
    shift = tuple(rng.integers(mask.shape))
    u = (np.roll(mask, shift, (0, 1)) + rng.random()) % 1.0
    return reweighted(np.sort(estimates, axis=0), _uniform(estimates), u)


def unlike_neighbours(
    estimates: FloatArray, mask: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Values unlike the neighbours' are likely: the energy of blue-noise masks, at one go."""
    mean = estimates.mean(axis=0)
    around = _around(mean, SIGMA_I)
    scale = mean.mean()
    values, others = (a / (a + scale) for a in (estimates, around))
    likeness = np.exp(-np.sqrt(np.abs(values - others)))
    return reweighted(estimates, _annealed(likeness, _TEMPERATURE), rng.random(mask.shape))


def in_turn(estimates: FloatArray, mask: FloatArray, rng: np.random.Generator) -> FloatArray:
    """
    Pixels of a checkerboard in two turns: the second makes up for the error around it.

    The truth is taken as known (1), which favours the choice.
    """
    shown = estimates.mean(axis=0)
    second = np.indices(shown.shape).sum(axis=0) % 2 == 1
    for turn in (~second, second):
        wanted = 1.0 - 2.0 * _around(shown - 1.0, 1.0)
        probability = _annealed(np.abs(estimates - wanted), 1.0)
        shown = np.where(turn, reweighted(estimates, probability, rng.random(mask.shape)), shown)
    return shown


def biased_in_turn(estimates: FloatArray, mask: FloatArray, rng: np.random.Generator) -> FloatArray:
    """The best estimate instead of a random one, and no weight: not bound by the theorem."""
    shown = estimates.mean(axis=0)
    sets = np.indices(shown.shape)
    number = 4 * (sets[0] % 4) + sets[1] % 4
    for index in rng.permutation(16):
        wanted = 1.0 - 2.0 * _around(shown - 1.0, 1.0)
        best = np.argmin(np.abs(estimates - wanted), axis=0)[None]
        choice = np.take_along_axis(estimates, best, axis=0)[0]
        shown = np.where(number == index, choice, shown)
    return shown


UNBIASED: Mapping[str, Rule] = {
    "uniform": uniform_choice,
    "mask": masked_choice,
    "unlike the neighbours": unlike_neighbours,
    "in turn": in_turn,
}
"""Choices without bias, by name."""


@dataclass(frozen=True)
class Powers:
    """
    Power spectra of the error of shown images and of the mean of their estimates.

    Fields
    ------
    shown, mean, added : array, (n, h, w)
        Of each realisation: of what is shown, of the mean of the estimates, and of what is shown
        minus that mean.
    """

    shown: FloatArray
    mean: FloatArray
    added: FloatArray


def choice_powers(
    rule: Rule, mask: npt.ArrayLike, estimates: int, realisations: int, seed: int
) -> Powers:
    """
    Power spectra of a choice among independent log-normal estimates of 1, for a test or a figure.

    Parameters
    ----------
    mask : array_like, (h, w)
        Values in (0, 1); gives the size.
    estimates : int
        Number k per pixel; their standard deviation is 1.
    realisations : int
        Number n of independent images.
    """
    rng = np.random.default_rng(seed)
    values = np.asarray(mask, dtype=np.float64)
    spread = np.sqrt(np.log(2.0))
    spectra = []
    for _ in range(realisations):
        g = np.exp(spread * rng.standard_normal((estimates, *values.shape)) - 0.5 * spread**2)
        mean = g.mean(axis=0)
        shown = rule(g, values, rng)
        spectra.append([power_spectrum(e, window="none") for e in (shown, mean, shown - mean)])
    return Powers(*np.stack(spectra, axis=1))


def _uniform(estimates: FloatArray) -> FloatArray:
    return np.full_like(estimates, 1.0 / len(estimates))


def _annealed(cost: FloatArray, temperature: float) -> FloatArray:
    """Probabilities that fall with the cost, by a defensive mixture with the uniform one."""
    p = np.exp((cost.min(axis=0) - cost) / temperature)
    return (1.0 - _DEFENSIVE) * p / p.sum(axis=0) + _DEFENSIVE / len(cost)


def _around(image: FloatArray, sigma: float) -> FloatArray:
    """Gaussian mean over a pixel's neighbours, without the pixel itself; toroidal."""
    weight = np.zeros(image.shape)
    weight[0, 0] = 1.0
    weight = ndimage.gaussian_filter(weight, sigma, mode="wrap")
    own = weight[0, 0]
    blurred = ndimage.gaussian_filter(image, sigma, mode="wrap")
    return np.asarray((blurred - own * image) / (1.0 - own))
