"""Power spectra of errors: where in frequency the noise lies.

Always of the relative error, never of the image, whose own content would dominate. White noise of
variance s² has power s² at every frequency. Frequencies are in cycles/pixel, 0 to 0.5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal

from .images import FloatArray, finite

__all__ = [
    "RadialSpectrum",
    "band_power",
    "low_frequency_share",
    "power_spectrum",
    "radial_spectrum",
    "white_power",
]

Window = Literal["hann", "none"]
Band = tuple[float, float]

FINE_BANDS: tuple[Band, ...] = (
    (0.008, 0.02),
    (0.02, 0.035),
    (0.035, 0.06),
    (0.06, 0.1),
    (0.1, 0.17),
    (0.17, 0.25),
    (0.25, 0.5),
)
# Reuse leaves its blotches in the first; blue noise is judged in the second.
TABLE_BANDS: tuple[Band, ...] = ((0.02, 0.06), (0.06, 0.17))


def power_spectrum(errors: ArrayLike, *, window: Window = "hann") -> FloatArray:
    """
    Power ``|sum_p h(p) (e(p) - mean e) exp(-2 pi i f.p)|² / sum h²``, averaged over frames.

    Parameters
    ----------
    errors : array_like, (H, W) or (F, H, W)
        Error images.
    window : {"hann", "none"}
        h: a Hann window, or 1 for periodic images such as masks.

    Returns
    -------
    ndarray, (H, W)
        In the order of `np.fft.fft2`: entry (0, 0) is the constant.
    """
    e = finite(errors, "The errors", (2, 3))
    e = e[None] if e.ndim == 2 else e
    h = _weights(e.shape[1:], window)
    centred = e - e.mean(axis=(1, 2), keepdims=True)
    power = np.zeros(e.shape[1:])
    for frame in centred:
        power += np.abs(np.fft.fft2(h * frame)) ** 2
    return power / (len(e) * np.sum(h**2))


def _weights(shape: tuple[int, ...], window: Window) -> FloatArray:
    if window == "none":
        return np.ones(shape)
    if window != "hann":
        raise ValueError(f"The window is 'hann' or 'none', not {window!r}.")
    rows, columns = (signal.windows.hann(n, sym=False) for n in shape)
    return np.outer(rows, columns)


def white_power(variance: ArrayLike, *, window: Window = "hann") -> float:
    """
    Power that independent noise has in `power_spectrum`, at every frequency, in expectation.

    Parameters
    ----------
    variance : array_like, (H, W)
        Of each pixel; it need not be the same everywhere: sum h² variance / sum h².
    window : {"hann", "none"}
    """
    v = finite(variance, "The variance", (2,))
    h = _weights(v.shape, window)
    return float(np.sum(h**2 * v) / np.sum(h**2))


def frequencies(shape: tuple[int, ...]) -> FloatArray:
    """Distance from the origin, in cycles/pixel, of each entry of an (H, W) power spectrum."""
    rows, columns = (np.fft.fftfreq(n) for n in shape)
    return np.hypot(rows[:, None], columns[None, :])


@dataclass(frozen=True)
class RadialSpectrum:
    """
    A power spectrum by distance from the origin.

    Fields
    ------
    frequency : ndarray, (n,)
        Mean frequency of each ring in cycles/pixel, up to 0.5.
    power : ndarray, (n,)
        Mean power.
    anisotropy : ndarray, (n,)
        sum (P - mean)² / ((n - 1) mean²) in the ring; 1/K in expectation for isotropic noise and K
        independent images.
    count : ndarray, (n,)
        Entries in the ring.
    """

    frequency: FloatArray
    power: FloatArray
    anisotropy: FloatArray
    count: FloatArray


def radial_spectrum(power: ArrayLike) -> RadialSpectrum:
    """
    Mean power and anisotropy in rings of width 1/N cycles/pixel, N the shorter side.

    Parameters
    ----------
    power : array_like, (H, W)
        Of `power_spectrum`. The constant is left out.
    """
    p = finite(power, "The power spectrum", (2,))
    f = frequencies(p.shape)
    ring = np.rint(f * min(p.shape)).astype(np.intp)
    inside = (f > 0.0) & (f <= 0.5)
    index, values = ring[inside], p[inside]
    size = int(index.max()) + 1
    count = np.bincount(index, minlength=size).astype(np.float64)
    used = count > 0
    safe = np.maximum(count, 1.0)
    mean = np.bincount(index, values, minlength=size) / safe
    spread = np.bincount(index, (values - mean[index]) ** 2, minlength=size)
    below = np.maximum(count - 1.0, 1.0) * mean**2
    anisotropy = np.divide(spread, below, out=np.zeros_like(spread), where=below > 0.0)
    frequency = np.bincount(index, f[inside], minlength=size) / safe
    return RadialSpectrum(frequency[used], mean[used], anisotropy[used], count[used])


def band_power(power: ArrayLike, bands: Sequence[Band] = FINE_BANDS) -> FloatArray:
    """
    Mean power in each band ``low <= |f| < high``; a band that ends at 0.5 includes it.

    Parameters
    ----------
    power : array_like, (..., H, W)
        One spectrum, or one of each chain.
    bands : sequence of (float, float)
        Limits in cycles/pixel.

    Returns
    -------
    ndarray, (..., B)

    Raises
    ------
    ValueError
        If a band is empty at this image size, or its limits are out of order.
    """
    p = np.asarray(power, dtype=np.float64)
    f = frequencies(p.shape[-2:])
    means = []
    for low, high in bands:
        if not 0.0 <= low < high <= 0.5:
            raise ValueError(f"A band needs 0 <= low < high <= 0.5 cycles/pixel, not {low}-{high}.")
        inside = (f >= low) & ((f < high) | ((f <= high) & (high == 0.5))) & (f > 0.0)
        if not inside.any():
            raise ValueError(
                f"No frequency of a {p.shape[-1]}x{p.shape[-2]} image lies in {low}-{high} "
                "cycles/pixel."
            )
        means.append(p[..., inside].mean(axis=-1))
    return np.stack(means, axis=-1)


def low_frequency_share(power: ArrayLike, *, limit: float = 0.125) -> float:
    """
    Mean power up to `limit` over the mean power of all frequencies: 1 for white noise.

    Adding noise at high frequencies lowers it too: always show the absolute power beside it.
    """
    p = finite(power, "The power spectrum", (2,))
    f = frequencies(p.shape)
    return float(p[(f > 0.0) & (f <= limit)].mean() / p[f > 0.0].mean())
