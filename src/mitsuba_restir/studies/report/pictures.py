"""Pictures of a report: what was rendered, where it is wrong, and what its noise looks like."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...analysis import spectrum
from ...analysis.covariance_images import covariance_map
from ...analysis.denoise import denoise
from ...analysis.images import luminance, smoothed_reference
from ...analysis.units import block_sums
from ...imageio import to_srgb8
from ..results import Measured, Run

Picture = npt.NDArray[np.uint8]

_ERROR_SCALE = 2.0
_PERCENTILE = 99.0
_BLOCK = 8
_SCORE = 4.0
_LEAST_RUNS = 4
# Anchors of two perceptually ordered maps: dark to bright, and blue over white to red.
_SEQUENTIAL = np.array(
    [[4, 4, 20], [66, 15, 117], [147, 38, 103], [221, 81, 58], [252, 165, 10], [252, 255, 164]]
)
_DIVERGING = np.array(
    [[5, 48, 97], [67, 147, 195], [209, 229, 240], [255, 255, 255], [253, 219, 199],
     [214, 96, 77], [103, 0, 31]]
)  # fmt: skip


@dataclass(frozen=True)
class Gallery:
    """
    Pictures of one kind, one for each variant.

    Fields
    ------
    key, title, about : str
        Name in file names, heading, and what is shown.
    pictures : mapping of str to array, (H, W, 3), uint8
        By variant.
    """

    key: str
    title: str
    about: str
    pictures: dict[str, Picture]


def galleries(data: Measured) -> list[Gallery]:
    """Make all pictures of one size; those that need what is missing are left out."""
    shown = {name: runs for name, runs in data.runs.items() if runs}
    if not shown:
        return []
    scale = exposure(data)
    found = [_images(data, shown, scale)]
    if data.reference is not None:
        found.append(_denoised(data, shown, scale))
        found.append(_errors(data, shown))
        found.append(_bias(data, shown))
        found.append(_covariances(data, shown))
        found.append(_spectra(data, shown))
    return [gallery for gallery in found if gallery.pictures]


def exposure(data: Measured) -> float:
    """Factor that brings the 90th percentile of the luminance to 0.8."""
    image = data.runs[data.baseline][0].mean if data.reference is None else data.reference.image
    return 0.8 / max(float(np.percentile(luminance(image), 90.0)), 1e-6)


def _images(data: Measured, shown: dict[str, Sequence[Run]], scale: float) -> Gallery:
    pictures = {name: to_srgb8(scale * runs[0].last) for name, runs in shown.items()}
    if data.reference is not None:
        pictures["reference"] = to_srgb8(scale * data.reference.image)
    about = f"The last frame of the first run, {scale:.2g} times as bright as rendered, as sRGB."
    return Gallery("images", "Images", about, pictures)


def _denoised(data: Measured, shown: dict[str, Sequence[Run]], scale: float) -> Gallery:
    try:
        pictures = {name: to_srgb8(scale * denoise(runs[0].last)) for name, runs in shown.items()}
    except ImportError:
        pictures = {}
    about = "The same frames after Intel Open Image Denoise, without guides."
    return Gallery("denoised", "Denoised", about, pictures)


def _errors(data: Measured, shown: dict[str, Sequence[Run]]) -> Gallery:
    assert data.reference is not None
    reference = data.reference.image
    pictures = {
        name: diverging(spectrum.relative_error(runs[0].last, reference) / _ERROR_SCALE)
        for name, runs in shown.items()
    }
    about = (
        "Error of the luminance of these frames over the smoothed reference: blue is too dark, red "
        f"too bright, full colour at ±{100 * _ERROR_SCALE:.0f} %."
    )
    return Gallery("errors", "Error maps", about, pictures)


def _bias(data: Measured, shown: dict[str, Sequence[Run]]) -> Gallery:
    """Means of blocks, whose noise is nearly normal, against the reference's."""
    assert data.reference is not None
    truth = block_sums(luminance(data.reference.image)[..., None], _BLOCK)[0]
    # Of the luminance: an upper bound, as if the channels' errors were one.
    spread = luminance(np.sqrt(data.reference.variance)) ** 2
    known = block_sums(spread[..., None], _BLOCK)[0]
    pictures = {}
    for name, runs in shown.items():
        if len(runs) < _LEAST_RUNS:
            continue
        sums = np.stack([block_sums(luminance(run.mean)[..., None], _BLOCK)[0] for run in runs])
        error = np.sqrt(sums.var(axis=0, ddof=1) / len(runs) + known)
        score = ((sums.mean(axis=0) - truth) / np.maximum(error, 1e-30))[..., 0]
        pictures[name] = np.kron(diverging(score / _SCORE), np.ones((4, 4, 1), dtype=np.uint8))
    about = (
        f"Mean of all frames and runs against the reference in blocks of {_BLOCK} pixels, over its "
        f"standard error: full colour at ±{_SCORE:.0f}. Without a bias one block in 20 is beyond "
        "2; colours that keep together are a bias, or a distribution with a heavy tail."
    )
    return Gallery("bias", "Bias", about, pictures)


def _covariances(data: Measured, shown: dict[str, Sequence[Run]]) -> Gallery:
    """One scale for all variants: that of the baseline."""
    assert data.reference is not None
    reference = data.reference.image
    ceiling = 5.0 * smoothed_reference(reference)
    maps = {}
    for name, runs in shown.items():
        if len(runs) < 2:
            continue
        clipped = np.stack([np.minimum(luminance(run.last), ceiling) for run in runs])
        maps[name] = covariance_map(clipped, reference)
    peak = 1.0
    if maps:
        peak = float(np.percentile(np.abs(maps.get(data.baseline, next(iter(maps.values())))), 99))
    pictures = {name: diverging(image / max(peak, 1e-30)) for name, image in maps.items()}
    about = (
        "Mean relative covariance of each pixel with those within 8 pixels, over independent runs "
        "(luminance clipped at 5 times the smoothed reference): red pixels err together with their "
        f"neighbours, blue ones against them; full colour at ±{peak:.2g}."
    )
    return Gallery("covariance", "Covariance maps", about, pictures)


def _spectra(data: Measured, shown: dict[str, Sequence[Run]]) -> Gallery:
    powers = {name: np.fft.fftshift(power) for name, power in error_spectra(data, shown).items()}
    low, high = 0.0, 1.0
    if powers:
        decibel = 10.0 * np.log10(np.maximum(next(iter(powers.values())), 1e-30))
        low, high = np.percentile(decibel, [1.0, _PERCENTILE])
    span = max(high - low, 1e-6)
    pictures = {
        name: sequential((10.0 * np.log10(np.maximum(p, 1e-30)) - low) / span)
        for name, p in powers.items()
    }
    about = (
        "Power of the relative error by frequency, mean over runs, zero frequency in the middle; "
        f"from {low:.0f} dB (dark) to {high:.0f} dB (bright)."
    )
    return Gallery("spectra", "Spectra", about, pictures)


def error_spectra(
    data: Measured, shown: dict[str, Sequence[Run]]
) -> dict[str, npt.NDArray[np.float64]]:
    """Mean power spectrum of the clipped relative error of the last frames, by variant."""
    assert data.reference is not None
    reference = data.reference.image
    return {
        name: np.mean(
            [
                spectrum.power_spectrum(spectrum.relative_error(run.last, reference, clip=4.0))
                for run in runs
            ],
            axis=0,
        )
        for name, runs in shown.items()
    }


def diverging(values: npt.NDArray[np.float64]) -> Picture:
    """Colour values from -1 (blue) over 0 (white) to 1 (red)."""
    return _colour(0.5 * (values + 1.0), _DIVERGING)


def sequential(values: npt.NDArray[np.float64]) -> Picture:
    """Colour values from 0 (dark) to 1 (bright)."""
    return _colour(values, _SEQUENTIAL)


def _colour(values: npt.NDArray[np.float64], anchors: npt.NDArray[np.int64]) -> Picture:
    x = np.clip(np.nan_to_num(values), 0.0, 1.0)
    places = np.linspace(0.0, 1.0, len(anchors))
    channels = [np.interp(x, places, anchors[:, c]) for c in range(3)]
    return np.stack(channels, axis=-1).round().astype(np.uint8)
