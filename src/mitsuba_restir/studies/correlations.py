"""Quantities of the noise between pixels, frames and runs: covariance and spectra."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from scipy import stats

from ..analysis import intervals, spectrum
from ..analysis.covariance import (
    covariance_of_products,
    ratio_of_products,
    relative_covariance,
    temporal_covariance,
)
from ..analysis.covariance_products import RunProducts, run_products
from ..analysis.images import FloatArray, luminance
from ..analysis.intervals import Interval
from .frame_errors import CLIP, chain_spectra, frames_of
from .results import Image, Measured, Row, Run
from .scalars import make_row, reference_of, rows_of_runs

# The low frequencies that eyes and denoisers see; what blue noise has little of.
_LOW = (0.0, 0.125)


def covariance(data: Measured) -> Iterator[Row]:
    """Relative covariance between runs within 8 pixels, mean over the frames of a run."""
    yield from _covariance(data, "", luminance)


def clipped_covariance(data: Measured) -> Iterator[Row]:
    """
    The same of luminance that is clipped at 5 times the smoothed reference.

    Where a few fireflies carry the covariance, this is what the rest of the image has.
    """
    ceiling = (1.0 + CLIP) * reference_of(data).scale
    yield from _covariance(data, ", clipped", lambda image: np.minimum(luminance(image), ceiling))


def _covariance(
    data: Measured, label: str, prepare: Callable[[Image], FloatArray]
) -> Iterator[Row]:
    found = {name: _products(data, runs, prepare) for name, runs in data.runs.items()}
    for name, own in found.items():
        total = covariance_of_products(own)
        ratio, p_value = None, None
        if partner := data.partner(name):
            ratio = ratio_of_products(own, found[partner])
            p_value = ratio_p_value(ratio, own.runs)
        quantity = f"relative covariance r=8{label}"
        yield make_row(data, name, quantity, "", total.covariance, ratio, p_value=p_value)
        yield make_row(data, name, f"{quantity}, with j=i", "", total.with_self, None)
        yield make_row(data, name, f"mean correlation r=8{label}", "", total.normalised, None)


def _products(
    data: Measured, runs: Sequence[Run], prepare: Callable[[Image], FloatArray]
) -> RunProducts:
    images = [np.stack([prepare(frame) for frame in frames_of(data, run)]) for run in runs]
    frames = [np.stack(same_frame) for same_frame in zip(*images, strict=True)]
    return run_products(frames, reference_of(data).image)


def ratio_p_value(ratio: Interval | None, runs: int) -> float | None:
    """Two-sided p-value of a ratio against 1: Student's t of its logarithm."""
    if ratio is None or not (ratio.value > 0.0 and ratio.standard_error > 0.0):
        return None
    score = np.log(ratio.value) * ratio.value / ratio.standard_error
    return float(2.0 * stats.t.sf(abs(score), runs - 1))


def bands(data: Measured) -> Iterator[Row]:
    """Power of the relative error by frequency band; each run is one chain."""
    spectra = chain_spectra(data, reference_of(data))
    f = spectrum.frequencies(spectra[data.baseline].shape[1:])
    # Small images have no frequency in the lowest bands.
    resolved = [
        (low, high)
        for low, high in (*spectrum.TABLE_BANDS, *spectrum.FINE_BANDS)
        if np.any((f >= low) & (f < high))
    ]
    for low, high in resolved:
        powers = {
            name: spectrum.band_power(own, [(low, high)])[:, 0] for name, own in spectra.items()
        }
        yield from rows_of_runs(data, f"power {low:g}-{high:g}", "", powers)


def low_frequencies(data: Measured) -> Iterator[Row]:
    """
    Power up to 1/8 cycle/pixel, and the same over the mean power: 1 for white noise.

    The curves that these sum up are in `spectra.csv`, which a report writes.
    """
    spectra = chain_spectra(data, reference_of(data))
    powers = {name: spectrum.band_power(own, [_LOW])[:, 0] for name, own in spectra.items()}
    yield from rows_of_runs(data, f"power 0-{_LOW[1]:g}", "", powers)
    for name, own in spectra.items():
        shares = np.array([spectrum.low_frequency_share(power, limit=_LOW[1]) for power in own])
        value = intervals.mean_interval(shares)
        yield make_row(data, name, "low-frequency share, white = 1", "", value, None)


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
                relative_covariance(frames, reference).covariance.value
                for frames in _luminances(runs)
            ]
        )
        for name, runs in data.runs.items()
    }
    yield from rows_of_runs(data, "covariance r=8 within a sequence", "", values)
