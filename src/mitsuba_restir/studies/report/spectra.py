"""Pictures of a report in frequency and offset: spectra, covariance by lag, masks, mutations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ...analysis import spectrum
from ...analysis.colours import Picture, diverging, sequential
from ...analysis.images import FloatArray
from ...imageio import to_srgb8
from ...sampling import masks
from ..config.study import Study, Variant
from ..measure.frame_errors import CLIP, frames_of, relative_errors
from ..measure.results import Measured
from .curves import LAG_RADIUS, Lags
from .pictures import Gallery, Shown
from .strips import crop_of

_MASKED = ("blue_noise", "blue_noise_seeds", "neighbor_sampling")
_MASK_CROP = 64
_MUTATION_CROP = 64
_MASK_RANGE = (-40.0, 10.0)  # decibel, relative to white noise
_PERCENTILES = (1.0, 99.5)
_LAG_PERCENTILE = 98.0
_GAP = 4


def spectra(powers: Mapping[str, FloatArray]) -> Gallery:
    """
    Draw the power of the errors of each variant by frequency.

    Parameters
    ----------
    powers : mapping of str to array, (K, H, W)
        Spectra of the runs; one scale for all variants.
    """
    decibel = {name: _decibel(own.mean(axis=0)) for name, own in powers.items()}
    low, high = _range(decibel)
    pictures = {name: _square(sequential((d - low) / (high - low))) for name, d in decibel.items()}
    about = (
        f"Power of the relative error (clipped at ±{CLIP:.0f}) by frequency, mean over runs: 0 in "
        f"the middle, ±0.5 cycles/pixel at the edges, from {low:.0f} dB (dark) to {high:.0f} dB "
        "(bright). Blotches are bright in the middle; blue noise is dark there."
    )
    return Gallery("spectra", "Spectra", about, pictures)


def _square(picture: Picture) -> Picture:
    """Give both frequencies, which reach as far, as many pixels."""
    side = max(picture.shape[:2])
    rows, columns = (np.arange(side) * n // side for n in picture.shape[:2])
    return picture[rows[:, None], columns[None, :]]


def _decibel(power: FloatArray) -> FloatArray:
    return 10.0 * np.log10(np.maximum(np.fft.fftshift(power), 1e-30))


def _range(decibel: Mapping[str, FloatArray]) -> tuple[float, float]:
    if not decibel:
        return 0.0, 1.0
    low, high = np.percentile(np.stack(list(decibel.values())), _PERCENTILES)
    return float(low), float(max(high, low + 1e-6))


def covariances_by_lag(curves: Mapping[str, Lags]) -> Gallery:
    """Draw the covariance of two pixels by their offset, at one scale for all variants."""
    peak = 1.0
    if curves:
        middle = np.arange((2 * LAG_RADIUS + 1) ** 2) != 2 * LAG_RADIUS * (LAG_RADIUS + 1)
        levels = [
            float(np.percentile(np.abs(curve.image.ravel()[middle]), _LAG_PERCENTILE))
            for curve in curves.values()
        ]
        peak = max(*levels, 1e-30)
    pictures = {
        name: np.kron(diverging(curve.image / peak), np.ones((8, 8, 1), dtype=np.uint8))
        for name, curve in curves.items()
    }
    about = (
        f"Relative covariance of two pixels by their offset, up to {LAG_RADIUS} pixels, mean over "
        f"the image (luminance clipped as above): full colour at ±{peak:.2g}. The middle is the "
        "variance. A wide red spot is what reuse leaves; blue noise has a blue ring about it."
    )
    return Gallery("lags", "Covariance by offset", about, pictures)


def mask_pictures(study: Study) -> Gallery:
    """Draw a white and the blue-noise mask with their spectra, where a variant uses a mask."""
    about = (
        f"The masks behind the blue-noise variants, {masks.SIZE} pixels wide: {_MASK_CROP} pixels "
        "of the white and of the void-and-cluster mask, and the power of each, 0 in the middle, "
        f"from {_MASK_RANGE[0]:.0f} dB (dark) to {_MASK_RANGE[1]:.0f} dB (bright) of white noise."
    )
    pictures: dict[str, Picture] = {}
    if any(_uses_mask(variant) for variant in study.variants.values()):
        for kind, label in (("white", "white"), ("void_and_cluster", "blue")):
            values = masks.mask_values(masks.load_mask(kind))
            power = spectrum.power_spectrum(values, window="none") / values.var()
            low, high = _MASK_RANGE
            crop = np.kron(values[:_MASK_CROP, :_MASK_CROP], np.ones((4, 4)))
            pictures[f"{label} mask"] = to_grey(crop)
            pictures[f"{label} mask, spectrum"] = sequential((_decibel(power) - low) / (high - low))
    return Gallery("masks", "Masks", about, pictures)


def _uses_mask(variant: Variant) -> bool:
    return any(
        variant.parameters.get(name, False) not in (False, "none", "random") for name in _MASKED
    )


def to_grey(values: npt.NDArray[np.floating[Any]]) -> Picture:
    """Show values from 0 to 1 as grey, (H, W) to (H, W, 3)."""
    grey = np.round(255.0 * np.clip(values, 0.0, 1.0)).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)


def mutation_pictures(study: Study, data: Measured, shown: Shown) -> Gallery:
    """
    Draw a crop of the frame and the spectrum of its error, side by side, for mutated variants.

    The spectrum is of the error: that of the picture itself would show the scene. It is the mean
    over frames and runs.
    """
    reference = data.reference
    mutated = {
        name
        for name, variant in study.variants.items()
        if int(variant.parameters.get("mutations", 0)) > 0
    }
    wanted = mutated | {study.baseline_of(name) for name in mutated}
    pictures: dict[str, Picture] = {}
    if mutated and reference is not None:
        rows, columns = crop_of(reference.luminance, smooth=True, side=_MUTATION_CROP)
        decibel = {}
        for name in (n for n in shown.runs if n in wanted):
            errors = [
                relative_errors(frames_of(data, run), reference, CLIP)[:, rows, columns]
                for run in shown.runs[name]
            ]
            decibel[name] = _decibel(spectrum.power_spectrum(np.concatenate(errors)))
        low, high = _range(decibel)
        for name, d in decibel.items():
            crop = to_srgb8(shown.scale * shown.frames[name][rows, columns])
            gap = np.full((crop.shape[0] * 4, _GAP, 3), 255, dtype=np.uint8)
            panels = (crop, sequential((d - low) / (high - low)))
            large = [np.kron(panel, np.ones((4, 4, 1), dtype=np.uint8)) for panel in panels]
            pictures[name] = np.concatenate([large[0], gap, large[1]], axis=1)
    about = (
        "Left, a crop of the frame at 4 times its size; right, the spectrum of the error there, "
        "mean over frames and runs, 0 in the middle."
    )
    return Gallery("mutations", "Mutations: crop and spectrum", about, pictures)
