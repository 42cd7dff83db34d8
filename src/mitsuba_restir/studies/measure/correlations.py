"""Quantities of the noise between pixels, frames and runs: covariance and spectra."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from operator import attrgetter

import numpy as np

from ...analysis import spectrum
from ...analysis.covariance import RunProducts, run_products, temporal_covariance
from ...analysis.images import FloatArray, luminance
from ..runs.results import Image, Run
from .frame_errors import CLIP, chain_spectra, frames_of, reference_noise
from .noise import refusal
from .results import Measured, Refused, Row
from .scalars import reference_of, row_of_jackknife, rows_of_runs

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
        base = found.get(data.partner(name) or "")
        quantity = f"relative covariance r=8{label}"
        for title, statistic in (
            (quantity, attrgetter("covariance")),
            (f"{quantity}, with j=i", attrgetter("with_self")),
            (f"mean correlation r=8{label}", attrgetter("correlation")),
        ):
            other = None if base is None else statistic(base)
            yield row_of_jackknife(data, name, title, statistic(own), other)


def _products(
    data: Measured, runs: Sequence[Run], prepare: Callable[[Image], FloatArray]
) -> RunProducts:
    images = [np.stack([prepare(frame) for frame in frames_of(data, run)]) for run in runs]
    frames = [np.stack(same_frame) for same_frame in zip(*images, strict=True)]
    return run_products(frames, reference_of(data).image)


def bands(data: Measured) -> Iterator[Row | Refused]:
    """Power of the relative error by frequency band; each run is one chain."""
    spectra = chain_spectra(data, reference_of(data))
    f = spectrum.frequencies(spectra[data.baseline].shape[1:])
    # Small images have no frequency in the lowest bands.
    resolved = [
        (low, high)
        for low, high in (*spectrum.TABLE_BANDS, *spectrum.FINE_BANDS)
        if np.any((f >= low) & (f < high))
    ]
    known = _known_noise(data)
    for band in resolved:
        yield from _band(data, spectra, known, band)


def _known_noise(data: Measured) -> FloatArray:
    """Power of the reference's own noise, which the spectra are without, (H, W)."""
    return reference_noise(reference_of(data), CLIP, "hann")


def _band(
    data: Measured, spectra: Mapping[str, FloatArray], known: FloatArray, band: spectrum.Band
) -> Iterator[Row | Refused]:
    name = f"power {band[0]:g}-{band[1]:g}"
    powers = {variant: spectrum.band_power(own, [band])[:, 0] for variant, own in spectra.items()}
    noise = float(spectrum.band_power(known, [band])[0])
    shares = {
        variant: noise / max(float(own.mean()) + noise, 1e-30) for variant, own in powers.items()
    }
    if refused := refusal(data.size, name, shares):
        yield refused
        return
    yield from rows_of_runs(data, name, "", powers)


def low_frequencies(data: Measured) -> Iterator[Row | Refused]:
    """
    Power up to 1/8 cycle/pixel, and the same over the mean power: 1 for white noise.

    The curves that these sum up are in `spectra.csv`, which a report writes.
    """
    spectra = chain_spectra(data, reference_of(data))
    found = list(_band(data, spectra, _known_noise(data), _LOW))
    yield from found
    silent = not all(own.any(axis=(1, 2)).all() for own in spectra.values())
    if silent or any(isinstance(row, Refused) for row in found):
        return
    shares = {
        name: np.array([spectrum.low_frequency_share(power, limit=_LOW[1]) for power in own])
        for name, own in spectra.items()
    }
    yield from rows_of_runs(data, "low-frequency share, white = 1", "", shares)


def covariance_of_frames(data: Measured) -> Iterator[Row]:
    """Covariance of consecutive frames, where every frame is kept."""
    reference = reference_of(data).image
    found = {
        name: temporal_covariance(np.stack(_luminances(runs)), reference)
        for name, runs in data.runs.items()
    }
    for name, own in found.items():
        base = found.get(data.partner(name) or "")
        yield row_of_jackknife(data, name, "covariance of consecutive frames", own, base)


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
            [run_products([frames], reference).covariance.value for frames in _luminances(runs)]
        )
        for name, runs in data.runs.items()
    }
    yield from rows_of_runs(data, "covariance r=8 within a sequence", "", values)
