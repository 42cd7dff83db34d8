"""Quantities of the noise between pixels, frames and runs: covariance and spectra."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from ...analysis import spectrum
from ...analysis.covariance import RunProducts, run_products, temporal_covariance
from ...analysis.images import FloatArray, luminance
from ..runs.results import Image, Run
from .frame_errors import CLIP, chain_spectra, frames_of, reference_noise
from .results import Measured, Number, Refused, Row
from .rows import reference_of, row_of_jackknife, rows_of_runs, unless_noisy

# The low frequencies that eyes and denoisers see; what blue noise has little of.
_LOW = (0.0, 0.125)

# Without the pixel itself, with it, and over the variance.
_STATISTICS = ("covariance", "with_self", "correlation")

BANDS = (*spectrum.TABLE_BANDS, *spectrum.FINE_BANDS)
"""Bands of frequencies whose power is measured."""


def covariance(data: Measured, numbers: Sequence[Number]) -> Iterator[Row]:
    """Relative covariance between runs within 8 pixels, mean over the frames of a run."""
    yield from _covariance(data, numbers, luminance)


def clipped_covariance(data: Measured, numbers: Sequence[Number]) -> Iterator[Row]:
    """
    The same of luminance that is clipped at 5 times the smoothed reference.

    Where a few fireflies carry the covariance, this is what the rest of the image has.
    """
    ceiling = (1.0 + CLIP) * reference_of(data).scale
    yield from _covariance(data, numbers, lambda image: np.minimum(luminance(image), ceiling))


def _covariance(
    data: Measured, numbers: Sequence[Number], prepare: Callable[[Image], FloatArray]
) -> Iterator[Row]:
    found = {name: _products(data, runs, prepare) for name, runs in data.runs.items()}
    for name, own in found.items():
        base = found.get(data.partner(name) or "")
        for number, statistic in zip(numbers, _STATISTICS, strict=True):
            other = None if base is None else getattr(base, statistic)
            yield row_of_jackknife(data, name, number, getattr(own, statistic), other)


def _products(
    data: Measured, runs: Sequence[Run], prepare: Callable[[Image], FloatArray]
) -> RunProducts:
    images = [np.stack([prepare(frame) for frame in frames_of(data, run)]) for run in runs]
    frames = [np.stack(same_frame) for same_frame in zip(*images, strict=True)]
    return run_products(frames, reference_of(data).image)


def bands(data: Measured, numbers: Sequence[Number]) -> Iterator[Row | Refused]:
    """Power of the relative error by frequency band; each run is one chain."""
    spectra = chain_spectra(data, reference_of(data))
    f = spectrum.frequencies(spectra[data.baseline].shape[1:])
    for number, band in zip(numbers, BANDS, strict=True):
        # Small images have no frequency in the lowest bands.
        if np.any((f >= band[0]) & (f < band[1])):
            yield from _band(data, spectra, number, band)


def _band(
    data: Measured, spectra: Mapping[str, FloatArray], number: Number, band: spectrum.Band
) -> Iterator[Row | Refused]:
    """Power in one band, without that of the reference's own noise."""
    powers = {variant: spectrum.band_power(own, [band])[:, 0] for variant, own in spectra.items()}
    known = reference_noise(reference_of(data), CLIP, "hann")
    noise = float(spectrum.band_power(known, [band])[0])
    shares = {
        variant: noise / max(float(own.mean()) + noise, 1e-30) for variant, own in powers.items()
    }
    yield from unless_noisy(data, number.name, shares, rows_of_runs(data, number, powers))


def low_frequencies(data: Measured, numbers: Sequence[Number]) -> Iterator[Row | Refused]:
    """
    Power up to 1/8 cycle/pixel, and the same over the mean power: 1 for white noise.

    The curves that these sum up are in `spectra.csv`, which a report writes.
    """
    power, share = numbers
    spectra = chain_spectra(data, reference_of(data))
    found = list(_band(data, spectra, power, _LOW))
    yield from found
    silent = not all(own.any(axis=(1, 2)).all() for own in spectra.values())
    if silent or any(isinstance(row, Refused) for row in found):
        return
    shares = {
        name: np.array([spectrum.low_frequency_share(power, limit=_LOW[1]) for power in own])
        for name, own in spectra.items()
    }
    yield from rows_of_runs(data, share, shares)


def covariance_of_frames(data: Measured, numbers: Sequence[Number]) -> Iterator[Row]:
    """Covariance of consecutive frames, where every frame is kept."""
    (number,) = numbers
    reference = reference_of(data).image
    found = {
        name: temporal_covariance(np.stack(_luminances(runs)), reference)
        for name, runs in data.runs.items()
    }
    for name, own in found.items():
        yield row_of_jackknife(data, name, number, own, found.get(data.partner(name) or ""))


def change_of_frames(data: Measured, numbers: Sequence[Number]) -> Iterator[Row]:
    """
    Mean square of the change of luminance from frame to frame, relative to the smoothed reference.

    Twice the variance less twice the covariance of consecutive frames.
    """
    (number,) = numbers
    scale = reference_of(data).scale
    values = {
        name: np.array(
            [np.mean((np.diff(frames, axis=0) / scale) ** 2) for frames in _luminances(runs)]
        )
        for name, runs in data.runs.items()
    }
    yield from rows_of_runs(data, number, values)


def _luminances(runs: Sequence[Run]) -> list[FloatArray]:
    """Luminance of every frame of every run, (F, H, W) each."""
    kept = (run.frames for run in runs)
    return [np.stack([luminance(f) for f in frames]) for frames in kept if frames is not None]


def covariance_in_sequence(data: Measured, numbers: Sequence[Number]) -> Iterator[Row]:
    """
    Relative covariance over consecutive frames of one sequence, mean over the runs.

    Not that of independent runs: the frames share their history, whose error their mean hides.
    """
    (number,) = numbers
    reference = reference_of(data).image
    values = {
        name: np.array(
            [run_products([frames], reference).covariance.value for frames in _luminances(runs)]
        )
        for name, runs in data.runs.items()
    }
    yield from rows_of_runs(data, number, values)
