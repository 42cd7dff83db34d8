r"""What reuse makes of white noise: the least error that a history of candidates leaves at a scale.

Where pixels have the same target function, merging is a linear average of what the candidates
contribute, whichever path is selected. Two things follow from that alone:

- a history merges frames with weights w_s, and has the noise of n = 1 / sum w_s² of them: 2 cap + 1
  where it is settled, fewer where its first frames still count;
- every round of spatial reuse spreads an error over the reuse radius, so that the errors of a frame
  that is a rounds old take a random walk of a steps, and meet those of as many more pixels.

Ratios of target functions between pixels and frames come on top of it: their error is what a frame
has in excess of this.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import optimize, special

from .images import FloatArray

Shape = tuple[int, int]


@dataclass(frozen=True)
class Reuse:
    """
    How paths are shared.

    Fields
    ------
    frames : int
        Frames of the history, the one that is shown included; 1 is no temporal reuse.
    cap : float
        Largest confidence of the history, in frames.
    neighbors : int
        Per pixel and round.
    radii : tuple of float
        Radius of each round of spatial reuse in pixels.
    feedback : int
        How many of the rounds the history goes through.
    young : float
        Largest confidence of the history, relative to the frames that it has had.
    """

    frames: int = 1
    cap: float = 0.0
    neighbors: int = 0
    radii: tuple[float, ...] = ()
    feedback: int = 16
    young: float = math.inf


@dataclass(frozen=True)
class Reach:
    """
    What a frame's error is at a scale, in terms of candidates: n frames of them through a Gaussian.

    Fields
    ------
    frames : float
        n = 1 / sum w_s².
    sigma : float
        Standard deviation of the Gaussian in pixels.
    """

    frames: float
    sigma: float


def power_of_reuse(reuse: Reuse, frequencies: FloatArray) -> FloatArray:
    r"""
    Power of what reuse makes of white noise of variance 1 in every frame, by frequency.

    One round with k neighbours in reciprocal pairs is z = a y + b (P_1 + ... + P_k) y with random
    permutations P_i and the weights of defensive pairwise MIS, a = (2k + 1) / (k + 1)² and
    b = k / (k + 1)². Its mean multiplies the power at f by (a + k b J(f))², J(f) = 2 J_1(x) / x
    with x = 2 pi R f the Fourier transform of the disk. What the choice of partners adds is
    k b² (1 - J(f)²) times the mean of (1 - J²) y²: none at f = 0, since nothing is lost or doubled.

    Parameters
    ----------
    frequencies : array, (H, W)
        All that an image of H x W pixels consists of [cycles/pixel]: `mirrored_frequencies`, or
        those of a torus.

    Returns
    -------
    array, (H, W)
    """
    disks = [_disk(radius * frequencies) for radius in reuse.radii]
    power, confidence = np.ones(frequencies.shape), 1.0
    shown = _rounds(power, reuse.neighbors, disks)
    for age in range(1, reuse.frames):
        kept = disks[: reuse.feedback]
        power = _rounds(power, reuse.neighbors, kept)
        # A reservoir's confidence is the sum of those that it was merged of.
        summed = confidence * (1 + reuse.neighbors) ** len(kept)
        confidence = min(summed, reuse.cap, reuse.young * age)
        power = (1.0 + confidence**2 * power) / (1.0 + confidence) ** 2
        confidence += 1.0
        shown = _rounds(power, reuse.neighbors, disks)
    return shown


def _rounds(power: FloatArray, k: int, disks: list[FloatArray]) -> FloatArray:
    own, each = (2 * k + 1) / (k + 1) ** 2, k / (k + 1) ** 2
    for disk in disks:
        lost = 1.0 - disk**2
        chosen = np.mean(lost * power) / max(float(np.mean(lost)), 1e-12)
        power = (own + k * each * disk) ** 2 * power + k * each**2 * lost * chosen
    return power


def _disk(x: FloatArray) -> FloatArray:
    angle = 2.0 * np.pi * x
    return np.where(angle > 0.0, 2.0 * special.j1(angle) / np.maximum(angle, 1e-12), 1.0)


def mirrored_frequencies(shape: Shape) -> FloatArray:
    """Frequencies [cycles/pixel] of the cosines of which a mirrored image consists."""
    rows, columns = (np.arange(n) / (2 * n) for n in shape)
    return np.hypot(rows[:, None], columns[None, :])


def seen(power: FloatArray, frequencies: FloatArray, sigma: float) -> float:
    """Mean square of an error of this power through a Gaussian of so many pixels."""
    return float(np.mean(power * np.exp(-((2.0 * np.pi * sigma * frequencies) ** 2))))


def reach(reuse: Reuse, shape: Shape, sigma: float) -> Reach:
    r"""
    Say how many frames of candidates, seen through which Gaussian, err as a frame does through one.

    By `power_of_reuse`. In a large image, with D per axis and round the variance of the walk,

        sum_s w_s² v / (4 pi (sigma² + D_s))  =  v / (4 pi n sigma'²).

    Parameters
    ----------
    reuse : Reuse
    shape : (int, int)
        Height and width of the image, mirrored at its border.
    sigma : float
        Of the Gaussian through which the frame is seen, in pixels.
    """
    frequencies = mirrored_frequencies(shape)
    power = power_of_reuse(reuse, frequencies)
    frames = 1.0 / float(power[0, 0])
    wanted = seen(power, frequencies, sigma) * frames

    def above(wide: float) -> float:
        return seen(np.ones(shape), frequencies, wide) - wanted

    widest = float(max(shape))
    if above(widest) >= 0.0:
        return Reach(frames, widest)
    return Reach(frames, float(optimize.brentq(above, 0.0, widest, xtol=1e-3)))
