"""Curves of a report: error over frames and time, power by frequency, covariance by distance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...analysis import spectrum
from ...analysis.covariance_images import lag_products
from ...analysis.images import FloatArray, luminance
from ..measure.errors import relmse
from ..measure.frame_errors import CLIP, frames_of
from ..measure.noise import refusal, shares, trimmed
from ..measure.results import Measured, Refused
from ..runs.results import ReferenceImage, Run

Values = npt.NDArray[np.float64]
Record = dict[str, str | float | int]

LAG_RADIUS = 12
"""Largest distance of two pixels whose covariance is shown."""


@dataclass(frozen=True)
class Curve:
    """
    Errors of one variant.

    Fields
    ------
    seconds : array, (F,)
        Median time until each frame is finished, over runs.
    single, average : array, (K, F)
        Trimmed relMSE of each frame, and of the average of all frames up to it, for each run.
    """

    seconds: Values
    single: Values
    average: Values


@dataclass(frozen=True)
class Radial:
    """
    Power of the relative error of one variant by frequency.

    Fields
    ------
    frequency, power, error : array, (n,)
        In cycles/pixel; mean over runs, and its standard error.
    ratio : (array, array) or None, (n,) each
        Power over that of the baseline, and the standard error of its logarithm.
    """

    frequency: Values
    power: Values
    error: Values
    ratio: tuple[Values, Values] | None


@dataclass(frozen=True)
class Lags:
    """
    Relative covariance of one variant by the offset of two pixels.

    Fields
    ------
    image : array, (2 R + 1, 2 R + 1)
        By offset; the variance in the middle.
    distance, covariance, error : array, (R,)
        Mean over offsets of (nearly) equal length, from 1 pixel on, and its jackknife error over
        runs.
    """

    image: Values
    distance: Values
    covariance: Values
    error: Values


def convergence(data: Measured) -> dict[str, Curve] | Refused:
    """Compute the errors of all variants whose frames are kept; empty without a reference."""
    if data.reference is None:
        return {}
    kept = {
        name: [run for run in runs if run.load_frames is not None and run.times.size > 1]
        for name, runs in data.runs.items()
    }
    means = {name: [run.mean for run in runs] for name, runs in kept.items()}
    refused = refusal(data.size, "the convergence", shares(data, means, trimmed))
    return refused or {name: _curve(data, runs) for name, runs in kept.items() if runs}


def _curve(data: Measured, runs: Sequence[Run]) -> Curve:
    single, average = [], []
    for run in runs:
        frames = run.frames
        assert frames is not None
        means = np.cumsum(frames, axis=0, dtype=np.float64)
        means /= np.arange(1, len(frames) + 1)[:, None, None, None]
        single.append([relmse(data, frame, data.trim) for frame in frames])
        average.append([relmse(data, mean, data.trim) for mean in means])
    seconds = np.median([np.cumsum(run.times) for run in runs], axis=0)
    return Curve(seconds, np.array(single), np.array(average))


def radial_powers(data: Measured, powers: Mapping[str, FloatArray]) -> dict[str, Radial]:
    """
    Compute power by frequency.

    Parameters
    ----------
    powers : mapping of str to array, (K, H, W)
        Spectra of the runs of each variant, as of `chain_spectra`.
    """
    rings = {
        name: [spectrum.radial_spectrum(power) for power in own] for name, own in powers.items()
    }
    values = {name: np.array([ring.power for ring in own]) for name, own in rings.items()}
    found = {}
    for name, own in values.items():
        partner = data.partner(name)
        ratio = None
        if partner and min(own.min(), values[partner].min()) > 0.0:
            ratio = _ratio(own, values[partner])
        frequency = rings[name][0].frequency
        found[name] = Radial(frequency, own.mean(axis=0), standard_error(own), ratio)
    return found


def _ratio(own: Values, base: Values) -> tuple[Values, Values]:
    """Ratio of means over runs, and the jackknife error of its logarithm."""
    runs = len(own)
    left_out = np.log(own.sum(axis=0) - own) - np.log(base.sum(axis=0) - base)
    error = np.sqrt((runs - 1) * left_out.var(axis=0))
    return own.mean(axis=0) / base.mean(axis=0), error


def lag_covariances(data: Measured) -> dict[str, Lags]:
    """Compute covariances by offset, of luminance clipped at 5 times the smoothed reference."""
    reference = data.reference
    if reference is None or min(reference.scale.shape) <= LAG_RADIUS:
        return {}
    ceiling = (1.0 + CLIP) * reference.scale
    found = {}
    for name, runs in data.runs.items():
        if len(runs) < 2:
            continue
        images = np.stack(
            [[np.minimum(luminance(f), ceiling) for f in frames_of(data, run)] for run in runs]
        )
        found[name] = _lags(images, reference)
    return found


def _lags(images: Values, reference: ReferenceImage) -> Lags:
    """Covariances of (K, F, H, W): between runs, mean over frames."""
    frames = np.moveaxis(images, 1, 0)
    products = np.mean(
        [lag_products(runs, reference.luminance, radius=LAG_RADIUS) for runs in frames], axis=0
    )
    count, total = len(products), products.sum(axis=0)
    offsets = np.arange(-LAG_RADIUS, LAG_RADIUS + 1)
    ring = np.rint(np.hypot(offsets[:, None], offsets[None, :])).astype(np.intp).ravel()

    def by_distance(lags: Values) -> Values:
        sums = np.bincount(ring, lags.ravel()) / np.bincount(ring)
        return np.asarray(sums[1 : LAG_RADIUS + 1])

    error = np.full(LAG_RADIUS, np.nan)
    if count > 2:
        left_out = [
            by_distance((total - own * count / (count - 1)) / (count - 2)) for own in products
        ]
        error = np.sqrt((count - 1) * np.var(left_out, axis=0))
    image = total / (count - 1)
    return Lags(image, np.arange(1.0, LAG_RADIUS + 1.0), by_distance(image), error)


def convergence_records(curves: Mapping[str, Curve], size: str) -> list[Record]:
    """Return the errors as flat records: mean over runs, and its standard error."""
    return [
        {
            "size": size,
            "variant": name,
            "frame": frame + 1,
            "seconds": float(curve.seconds[frame]),
            "relmse_trimmed": float(curve.single[:, frame].mean()),
            "relmse_trimmed_error": float(standard_error(curve.single)[frame]),
            "relmse_trimmed_of_average": float(curve.average[:, frame].mean()),
            "relmse_trimmed_of_average_error": float(standard_error(curve.average)[frame]),
        }
        for name, curve in curves.items()
        for frame in range(len(curve.seconds))
    ]


def radial_records(curves: Mapping[str, Radial], size: str) -> list[Record]:
    """Return the powers as flat records."""
    return [
        {
            "size": size,
            "variant": name,
            "cycles_per_pixel": float(curve.frequency[i]),
            "power": float(curve.power[i]),
            "power_error": float(curve.error[i]),
            "ratio": "" if curve.ratio is None else float(curve.ratio[0][i]),
            "log_ratio_error": "" if curve.ratio is None else float(curve.ratio[1][i]),
        }
        for name, curve in curves.items()
        for i in range(len(curve.frequency))
    ]


def lag_records(curves: Mapping[str, Lags], size: str) -> list[Record]:
    """Return the covariances as flat records, one for each offset."""
    return [
        {
            "size": size,
            "variant": name,
            "dx": column - LAG_RADIUS,
            "dy": row - LAG_RADIUS,
            "relative_covariance": float(curve.image[row, column]),
        }
        for name, curve in curves.items()
        for row in range(curve.image.shape[0])
        for column in range(curve.image.shape[1])
    ]


def standard_error(values: Values) -> Values:
    """Standard error of the mean over runs; zero for a single run."""
    if len(values) < 2:
        return np.zeros(values.shape[1])
    return np.asarray(values.std(axis=0, ddof=1) / np.sqrt(len(values)))
