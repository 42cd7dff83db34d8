"""Relative errors of a run's frames, their spectra, and what the reference's noise adds to them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ...analysis import metrics, spectrum
from ...analysis.images import FloatArray, luminance
from ..runs.results import Image, ReferenceImage, Run
from .results import Measured

CLIP = 4.0
"""Relative errors are clipped to +-4: fireflies are white noise that would hide all else."""

SIGMA = 1.5
"""Of the Gaussian through which the filtered error is seen, in pixels."""

BLOTCHES = (3.0, 8.0)
"""Of the Gaussians through which nothing but blotches is seen, in pixels."""


def frames_of(data: Measured, run: Run) -> Image:
    """
    Return the frames of a run whose numbers are averaged, (F, H, W, 3).

    After a warm-up all measured frames are alike, and so all that were kept count; without one the
    error falls from frame to frame, and only the last counts.
    """
    frames = run.frames if data.settled else None
    return run.last[None] if frames is None else frames


def last_frame_of(data: Measured, run: Run) -> Image:
    """Return the last of these frames, (1, H, W, 3), for what takes seconds to compute."""
    return frames_of(data, run)[-1:]


def every_frame(_: Measured, run: Run) -> Image:
    """Return all measured frames of a run that kept them, (F, H, W, 3)."""
    frames = run.frames
    assert frames is not None
    return frames


def relative_errors(frames: ArrayLike, reference: ReferenceImage, clip: float | None) -> FloatArray:
    """Relative errors of luminance, (F, H, W), of frames (F, H, W, 3) or of luminance itself."""
    images = [luminance(image) for image in np.asarray(frames)]
    errors = (np.stack(images) - reference.luminance) / reference.scale
    return errors if clip is None else np.clip(errors, -clip, clip)


def reference_noise(
    reference: ReferenceImage, clip: float | None, window: spectrum.Window = "none"
) -> FloatArray:
    """
    Return the expected power of the reference's own noise in a power spectrum of relative errors.

    Of a pixel whose errors are clipped at `clip` it is not more than that. White where pixels are
    independent. Smoothing by a Gaussian of s pixels multiplies it by
    exp(-(2 pi s f)²), whose mean over all frequencies is what the variance fell by.

    Returns
    -------
    array, (H, W)
        In the order of `np.fft.fft2`.
    """
    variance = reference.luminance_variance / reference.scale**2
    if clip is not None:
        variance = np.minimum(variance, clip**2)
    level = spectrum.white_power(variance, window=window)
    f = spectrum.frequencies(variance.shape)
    shape = np.exp(-((2.0 * np.pi * reference.smooth * f) ** 2))
    return np.asarray(level * shape / shape.mean())


def filtered_mse(frames: Image, reference: ReferenceImage, sigma: float = SIGMA) -> float:
    """Mean square of the clipped relative error seen through a Gaussian of so many pixels."""
    errors = relative_errors(frames, reference, CLIP)
    return metrics.filtered_mse(errors, sigma) - filtered_noise(reference, sigma)


def filtered_noise(reference: ReferenceImage, sigma: float = SIGMA) -> float:
    """Mean square of the reference's own noise, seen through the same Gaussian."""
    noise = reference_noise(reference, CLIP)
    f = spectrum.frequencies(noise.shape)
    return float(np.mean(noise * np.exp(-((2.0 * np.pi * sigma * f) ** 2))))


def chain_spectra(data: Measured, reference: ReferenceImage) -> dict[str, FloatArray]:
    """Power spectrum of every run's clipped relative errors, (K, H, W), by variant."""
    noise = reference_noise(reference, CLIP, "hann")
    return {
        name: np.stack(
            [
                spectrum.power_spectrum(relative_errors(frames_of(data, run), reference, CLIP))
                for run in runs
            ]
        )
        - noise
        for name, runs in data.runs.items()
        if runs
    }
