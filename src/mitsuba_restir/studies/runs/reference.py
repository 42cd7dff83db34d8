"""The reference of a study: read from files, or rendered by Mitsuba's `path`; and smoothed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ...errors import UsageError
from ...imageio import read_rgb
from ..config.study import Study
from .results import Image, ReferenceImage
from .scene import expand

LEAST_BATCHES = 8
"""From fewer, a variance cannot be told."""


class BatchMean:
    """
    Mean of batches of samples, weighted by their samples.

    The variance of a sample is that of the means of n samples about the mean of all, times n.

    Parameters
    ----------
    size : (int, int)
        Width and height in pixels.

    Fields
    ------
    count, samples : int
        Batches and samples per pixel taken so far.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        self.count = self.samples = 0
        self._sum, self._squares = np.zeros((2, size[1], size[0], 3))

    def add(self, batch: Image, samples: int) -> None:
        """Take the next batch, (H, W, 3)."""
        values = batch.astype(np.float64)
        self.count += 1
        self.samples += samples
        self._sum += samples * values
        self._squares += samples * values**2

    def image(self) -> ReferenceImage:
        """Return the mean and its variance."""
        mean = self._sum / self.samples
        spread = np.maximum(self._squares / self.samples - mean**2, 0.0)
        return ReferenceImage(mean, spread / max(self.count - 1, 1), samples=self.samples)


def read_reference(study: Study) -> ReferenceImage:
    """
    Read a study's reference files.

    Raises
    ------
    UsageError
        A file is missing, no image, or of another size than the study's.
    """
    assert study.reference is not None
    image = _read(study, study.reference.file)
    variance = np.zeros_like(image)
    if study.reference.variance:
        variance = _read(study, study.reference.variance)
    if variance.min() < 0.0:
        raise UsageError(f"{study.name}: {study.reference.variance} has negative values")
    return ReferenceImage(image, variance)


def smooth(reference: ReferenceImage, sigma: float) -> ReferenceImage:
    """
    Smooth a reference by a Gaussian of `sigma` pixels.

    Its variance falls by the sum of the squared weights, 1/(4 pi sigma²) for a wide Gaussian, whose
    square is a Gaussian of sigma / sqrt(2).
    """
    if sigma == 0.0:
        return reference
    image = _blur(reference.image, sigma)
    impulse = np.zeros((8 * int(np.ceil(sigma)) + 1,) * 2)
    impulse[impulse.shape[0] // 2, impulse.shape[1] // 2] = 1.0
    weights = ndimage.gaussian_filter(impulse, sigma)
    variance = _blur(reference.variance, sigma / np.sqrt(2.0)) * float(np.sum(weights**2))
    return ReferenceImage(image, variance, sigma, reference, reference.samples)


def _blur(image: npt.NDArray[np.float64], sigma: float) -> npt.NDArray[np.float64]:
    return np.asarray(ndimage.gaussian_filter(image, (sigma, sigma, 0.0), mode="nearest"))


def _read(study: Study, file: str) -> npt.NDArray[np.float64]:
    image = np.asarray(read_rgb(Path(expand(file))), dtype=np.float64)
    width, height = study.sizes[0]
    if image.shape[:2] != (height, width):
        raise UsageError(
            f"{study.name}: {file} has {image.shape[1]}x{image.shape[0]} pixels, the study "
            f"{width}x{height}"
        )
    if not np.isfinite(image).all():
        raise UsageError(f"{study.name}: {file} has values that are NaN or infinite")
    return image
