"""Curves of a report: error over frames and time, power by frequency, covariance by distance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ...analysis import spectrum
from ...analysis.covariance_images import lag_products
from ...analysis.images import FloatArray, luminance
from ..measure.errors import relmse
from ..measure.frame_errors import CLIP, chain_spectra, frames_of
from ..measure.noise import refusal, shares, trimmed
from ..measure.results import Measured, Refused
from ..runs.results import ReferenceImage, Run

Values = npt.NDArray[Any]
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

    def columns(self) -> dict[str, Values]:
        """Return what is written to a file: means over runs, and their standard errors."""
        return {
            "frame": np.arange(1, len(self.seconds) + 1),
            "seconds": self.seconds,
            "relmse_trimmed": self.single.mean(axis=0),
            "relmse_trimmed_error": standard_error(self.single),
            "relmse_trimmed_of_average": self.average.mean(axis=0),
            "relmse_trimmed_of_average_error": standard_error(self.average),
        }


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

    def columns(self) -> dict[str, Values]:
        """Return what is written to a file; nothing (an empty field) where there is no ratio."""
        nothing = np.full(self.power.shape, "", dtype=object)
        ratio, error = (nothing, nothing) if self.ratio is None else self.ratio
        return {
            "cycles_per_pixel": self.frequency,
            "power": self.power,
            "power_error": self.error,
            "ratio": ratio,
            "log_ratio_error": error,
        }


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

    def columns(self) -> dict[str, Values]:
        """Return what is written to a file, one line for each offset."""
        dy, dx = np.indices(self.image.shape) - LAG_RADIUS
        return {"dx": dx.ravel(), "dy": dy.ravel(), "relative_covariance": self.image.ravel()}


@dataclass(frozen=True)
class Curves:
    """
    All curves of one size, by variant; empty where there are none.

    Fields
    ------
    powers : mapping of str to array, (K, H, W)
        Spectra of the runs of each variant, as of `chain_spectra`.
    """

    powers: Mapping[str, FloatArray]
    convergence: Mapping[str, Curve]
    radial: Mapping[str, Radial]
    lags: Mapping[str, Lags]

    def files(self) -> dict[str, Mapping[str, Curve | Radial | Lags]]:
        """Return what is written to files, by name."""
        return {"curves": self.convergence, "spectra": self.radial, "covariances": self.lags}


def curves_of(data: Measured, notes: list[str]) -> Curves:
    """Compute all curves; a note instead of those for which the reference is too noisy."""
    errors = convergence(data)
    if isinstance(errors, Refused):
        notes.append(errors.reason)
        errors = {}
    powers = {} if data.reference is None else chain_spectra(data, data.reference)
    return Curves(powers, errors, radial_powers(data, powers), lag_covariances(data))


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


def records(curves: Mapping[str, Curve | Radial | Lags], size: str) -> list[Record]:
    """Return the curves of a size as flat records."""
    return [
        {"size": size, "variant": name, **dict(zip(columns, values, strict=True))}
        for name, columns in ((name, curve.columns()) for name, curve in curves.items())
        for values in zip(*(column.tolist() for column in columns.values()), strict=True)
    ]


def standard_error(values: Values) -> Values:
    """Standard error of the mean over runs; zero for a single run."""
    if len(values) < 2:
        return np.zeros(values.shape[1])
    return np.asarray(values.std(axis=0, ddof=1) / np.sqrt(len(values)))
