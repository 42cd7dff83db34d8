"""Quantities of the noise between pixels, frames and runs: covariance and spectra."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..analysis import perceptual, spectrum
from ..analysis.covariance import covariance_ratio, relative_covariance, temporal_covariance
from ..analysis.images import FloatArray
from ..analysis.pixel_bias import mean_bias
from .results import Measured, ReferenceImage, Row, Run
from .scalars import make_row, reference_of

# Fireflies are white noise at a power that would hide everything else.
_CLIP = 4.0
_SIGMA = 1.5


def covariance(data: Measured) -> Iterator[Row]:
    """Relative covariance of the last frames of the runs, within 8 pixels."""
    reference = reference_of(data).image
    stacks = {name: np.stack([run.last for run in runs]) for name, runs in data.runs.items()}
    base = stacks[data.baseline]
    for name, own in stacks.items():
        found = relative_covariance(own, reference)
        ratio = None
        if name != data.baseline and len(own) == len(base):
            ratio = covariance_ratio(own, base, reference)
        yield make_row(data, name, "relative covariance r=8", "", found.covariance, ratio)
        yield make_row(data, name, "relative covariance r=8, with j=i", "", found.with_self, None)
        yield make_row(data, name, "mean correlation r=8", "", found.normalised, None)


def relative_errors(run: Run, reference: ReferenceImage) -> FloatArray:
    """Clipped relative errors of the last frame, or of all where they are kept: (F, H, W)."""
    frames = run.last[None] if run.frames is None else run.frames
    errors = [spectrum.relative_error(image, reference.image, clip=_CLIP) for image in frames]
    return np.stack(errors)


def bands(data: Measured) -> Iterator[Row]:
    """Power of the relative error by frequency band; each run is one chain."""
    reference = reference_of(data)
    spectra = {
        name: np.stack([spectrum.power_spectrum(relative_errors(run, reference)) for run in runs])
        for name, runs in data.runs.items()
    }
    base = spectra[data.baseline]
    f = spectrum.frequencies(base.shape[1:])
    # Small images have no frequency in the lowest bands.
    resolved = [
        (low, high)
        for low, high in (*spectrum.TABLE_BANDS, *spectrum.FINE_BANDS)
        if np.any((f >= low) & (f < high))
    ]
    for name, own in spectra.items():
        other = base if name != data.baseline and len(own) == len(base) else None
        for found in spectrum.compare_bands(own, other, bands=resolved):
            low, high = found.band
            yield make_row(data, name, f"power {low:g}-{high:g}", "", found.power, found.ratio)


def filtered_mse(run: Run, reference: ReferenceImage) -> float:
    """Mean squared relative error of a run's frames, seen through a Gaussian of 1.5 pixels."""
    return perceptual.filtered_mse(relative_errors(run, reference), _SIGMA)


def covariance_of_frames(data: Measured) -> Iterator[Row]:
    """Covariance of consecutive frames, where every frame is kept."""
    reference = reference_of(data).image
    for name, runs in data.runs.items():
        frames = [run.frames for run in runs if run.frames is not None]
        value = temporal_covariance(np.stack(frames), reference)
        yield make_row(data, name, "covariance of consecutive frames", "", value, None)


def paired_mean(data: Measured) -> Iterator[Row]:
    """Relative difference of mean luminance from the baseline, over the same runs."""
    base = [run.mean for run in data.runs[data.baseline]]
    for name, runs in data.runs.items():
        if name != data.baseline and len(runs) == len(base) > 1:
            value = mean_bias(np.stack([run.mean for run in runs]), np.stack(base))
            yield make_row(data, name, "mean against the baseline, minus 1", "", value, None)
