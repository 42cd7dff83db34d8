"""Quantities of the noise between pixels, frames and runs: covariance and spectra."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from scipy import stats

from ..analysis import perceptual, spectrum
from ..analysis.covariance import covariance_ratio, relative_covariance, temporal_covariance
from ..analysis.images import FloatArray, luminance, smoothed_reference
from ..analysis.intervals import Interval
from ..analysis.pixel_bias import mean_bias
from .results import Image, Measured, ReferenceImage, Row, Run
from .scalars import make_row, reference_of, rows_of_runs

# Fireflies are white noise at a power that would hide everything else.
_CLIP = 4.0
_SIGMA = 1.5


def covariance(data: Measured) -> Iterator[Row]:
    """Relative covariance of the last frames of the runs, within 8 pixels."""
    yield from _covariance(data, "", lambda image: np.asarray(image, dtype=np.float64))


def clipped_covariance(data: Measured) -> Iterator[Row]:
    """
    The same of luminance that is clipped at 5 times the smoothed reference.

    Where a few fireflies carry the covariance, this is what the rest of the image has.
    """
    ceiling = (1.0 + _CLIP) * smoothed_reference(reference_of(data).image)
    yield from _covariance(data, ", clipped", lambda image: np.minimum(luminance(image), ceiling))


def _covariance(
    data: Measured, label: str, prepare: Callable[[Image], FloatArray]
) -> Iterator[Row]:
    reference = reference_of(data).image
    stacks = {
        name: np.stack([prepare(run.last) for run in runs]) for name, runs in data.runs.items()
    }
    for name, own in stacks.items():
        found = relative_covariance(own, reference)
        ratio, p_value = None, None
        if partner := data.partner(name):
            ratio = covariance_ratio(own, stacks[partner], reference)
            p_value = _p_value(ratio, len(own))
        quantity = f"relative covariance r=8{label}"
        yield make_row(data, name, quantity, "", found.covariance, ratio, p_value=p_value)
        yield make_row(data, name, f"{quantity}, with j=i", "", found.with_self, None)
        yield make_row(data, name, f"mean correlation r=8{label}", "", found.normalised, None)


def _p_value(ratio: Interval, runs: int) -> float | None:
    """Two-sided p-value of a bootstrapped ratio against 1: Student's t of its logarithm."""
    if not (ratio.value > 0.0 and ratio.standard_error > 0.0):
        return None
    score = np.log(ratio.value) * ratio.value / ratio.standard_error
    return float(2.0 * stats.t.sf(abs(score), runs - 1))


def relative_errors(run: Run, reference: ReferenceImage) -> FloatArray:
    """Clipped relative errors of the last frame, or of all where they are kept: (F, H, W)."""
    frames = run.frames
    frames = run.last[None] if frames is None else frames
    errors = [spectrum.relative_error(image, reference.image, clip=_CLIP) for image in frames]
    return np.stack(errors)


def bands(data: Measured) -> Iterator[Row]:
    """Power of the relative error by frequency band; each run is one chain."""
    reference = reference_of(data)
    spectra = {
        name: np.stack([spectrum.power_spectrum(relative_errors(run, reference)) for run in runs])
        for name, runs in data.runs.items()
    }
    f = spectrum.frequencies(spectra[data.baseline].shape[1:])
    # Small images have no frequency in the lowest bands.
    resolved = [
        (low, high)
        for low, high in (*spectrum.TABLE_BANDS, *spectrum.FINE_BANDS)
        if np.any((f >= low) & (f < high))
    ]
    for name, own in spectra.items():
        partner = data.partner(name)
        other = spectra[partner] if partner else None
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
        value = temporal_covariance(np.stack(_luminances(runs)), reference)
        yield make_row(data, name, "covariance of consecutive frames", "", value, None)


def _luminances(runs: Sequence[Run]) -> list[FloatArray]:
    """Luminance of every frame of every run, (F, H, W) each."""
    kept = ((run, run.frames) for run in runs)
    return [
        np.stack([luminance(frame) for frame in frames]) for _, frames in kept if frames is not None
    ]


def covariance_in_sequence(data: Measured) -> Iterator[Row]:
    """
    Relative covariance over consecutive frames of one sequence, mean over the runs.

    Not that of independent runs: the frames share their history, whose error their mean hides.
    """
    reference = reference_of(data).image
    values = {
        name: np.array(
            [
                relative_covariance(frames, reference, resamples=2).covariance.value
                for frames in _luminances(runs)
            ]
        )
        for name, runs in data.runs.items()
    }
    yield from rows_of_runs(data, "covariance r=8 within a sequence", "", values)


def paired_mean(data: Measured) -> Iterator[Row]:
    """Relative difference of mean luminance from the baseline, over the same runs."""
    for name, runs in data.runs.items():
        if partner := data.partner(name):
            pair = [np.stack([run.mean for run in other]) for other in (runs, data.runs[partner])]
            value = mean_bias(*pair)
            yield make_row(data, name, "mean against the baseline, minus 1", "", value, None)
