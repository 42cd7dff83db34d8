"""The reference of a study: read from files, or rendered by Mitsuba's `path` in batches."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ...errors import UsageError
from ...imageio import read_rgb
from ..config.study import REFERENCE, Reference, Size, Study, Variant
from ..runs.batches import LEAST_BATCHES, BatchMean
from ..runs.rendering import make_renderer, seed_of
from ..runs.results import ReferenceImage
from ..runs.scene import expand
from .folder import StudyFolder

# First entries of the seed keys: references share no random numbers with runs.
RUN_KEY, REFERENCE_KEY, REHEARSAL_KEY = 0, 1, 2


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


def missing_batches(folder: StudyFolder, size: Size) -> list[int]:
    """Return the numbers of the batches that are still to be rendered, at most."""
    reference = folder.study.reference
    if reference is None or reference.file:
        return []
    if _finished(folder, size, reference) is not None:
        return []
    return [b for b in range(reference.batches) if folder.load_batch(size, b) is None]


def _is_enough(mean: BatchMean, asked: Reference) -> bool:
    """
    Say whether no more batches are wanted.

    They are enough when they are all, or when the mean of at least 8 is as sure as the study asks:
    the same ones however many more another study has rendered.
    """
    if mean.count == asked.batches:
        return True
    return 0.0 < asked.noise and mean.count >= LEAST_BATCHES and mean.image().noise <= asked.noise


def _finished(folder: StudyFolder, size: Size, reference: Reference) -> ReferenceImage | None:
    """Return the reference; None where batches that it needs are not there yet."""
    mean = BatchMean(size)
    while not _is_enough(mean, reference):
        batch = folder.load_batch(size, mean.count)
        if batch is None:
            return None
        mean.add(batch, reference.spp // reference.batches)
    return mean.image()


def render_batches(
    folder: StudyFolder, scene: Any, size: Size, batches: list[int], done: Callable[[], None]
) -> None:
    """Render and save those of some batches that are needed, calling `done` for each of them."""
    study = folder.study
    assert study.reference is not None
    # Russian roulette saves time but adds variance, which the deepest paths feel most.
    parameters = {"max_depth": study.max_depth, "rr_depth": 1_000_000}
    spp = study.reference.spp // study.reference.batches
    variant = Variant("path", spp, parameters)
    renderer = make_renderer(study, scene, size, REFERENCE, variant)
    mean = BatchMean(size)
    while not _is_enough(mean, study.reference):
        index = mean.count
        image = None if index in batches else folder.load_batch(size, index)
        if image is None:
            image, _ = renderer.frame(seed_of(0, REFERENCE_KEY, index))
            folder.save_batch(size, index, image)
        mean.add(image, spp)
        if index in batches:
            done()
    for _ in (batch for batch in batches if batch >= mean.count):
        done()


def load_reference(folder: StudyFolder, size: Size) -> ReferenceImage | None:
    """Return the finished reference of a size; None where the study has none."""
    reference = folder.study.reference
    if reference is None:
        return None
    if reference.file:
        return smooth(read_reference(folder.study), reference.smooth)
    found = _finished(folder, size, reference)
    if found is None:
        raise UsageError(f"{folder.path}: batches of the reference are missing")
    return smooth(found, reference.smooth)


def notes_on_reference(study: Study, reference: ReferenceImage | None) -> list[str]:
    """Say where a reference is not as sure as the study asks."""
    asked = study.reference
    if reference is None or asked is None:
        return []
    if asked.file and not asked.variance:
        return [
            f"the error of the reference {asked.file} is not known: it counts as that of every "
            "variant, and tests of bias take it as exact; a variance can be given"
        ]
    if asked.smooth or not 0.0 < asked.noise < reference.noise:
        return []
    return [
        f"the reference's noise is {100 * reference.noise:.2g} % in the median, not "
        f"{100 * asked.noise:.2g} %: {asked.spp} samples per pixel are not enough for that"
    ]
