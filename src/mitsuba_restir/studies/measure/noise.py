"""Refusing comparisons with a reference that is noisier than what is compared with it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping

import numpy as np
from scipy import ndimage

from ...analysis import metrics
from ..runs.results import Image, ReferenceImage
from .frame_errors import CLIP, SIGMA, filtered_noise, reference_noise, relative_errors
from .results import Measured, Refused

Parts = Callable[[Measured, Image, ReferenceImage], tuple[float, float]]
"""Mean square that is measured of an image, and how much of it is the reference's own noise."""

LIMIT = 0.5
"""Largest share of what is measured that may be the reference's own noise."""


def absolute(_: Measured, image: Image, reference: ReferenceImage) -> tuple[float, float]:
    """Of the squared error."""
    return float(np.mean((image - reference.image) ** 2)), float(np.mean(reference.variance))


def displayed(_: Measured, image: Image, reference: ReferenceImage) -> tuple[float, float]:
    """Of the squared error as a screen shows it."""
    error = metrics.displayed(image) - metrics.displayed(reference.image)
    noise = metrics.displayed_variance(reference.image, reference.variance)
    return float(np.mean(error**2)), float(np.mean(noise))


def relmse(data: Measured, image: Image, reference: ReferenceImage) -> tuple[float, float]:
    """Of relMSE."""
    return _relmse(image, reference, data.epsilon, 0.0)


def trimmed(data: Measured, image: Image, reference: ReferenceImage) -> tuple[float, float]:
    """Of relMSE without the worst pixels."""
    return _relmse(image, reference, data.epsilon, data.trim)


def _relmse(
    image: Image, reference: ReferenceImage, epsilon: float, trim: float
) -> tuple[float, float]:
    # Where the reference is too dark by its noise, its own square would make the error seem
    # larger, and the noise a smaller part of it than it is.
    smooth = ndimage.gaussian_filter(reference.image, (SIGMA, SIGMA, 0.0))
    weight = 1.0 / (np.maximum(reference.image, smooth) ** 2 + epsilon)
    errors = ((image - reference.image) ** 2 * weight).mean(axis=2).ravel()
    noise = (reference.variance * weight).mean(axis=2).ravel()
    kept = np.argsort(errors)[: errors.size - int(trim * errors.size)]
    return float(errors[kept].mean()), float(noise[kept].mean())


def relative(_: Measured, image: Image, reference: ReferenceImage) -> tuple[float, float]:
    """Of the squared relative error of luminance."""
    return _relative(image, reference, None)


def clipped(_: Measured, image: Image, reference: ReferenceImage) -> tuple[float, float]:
    """Of the squared relative error of luminance, clipped: that of all but the fireflies."""
    return _relative(image, reference, CLIP)


def _relative(image: Image, reference: ReferenceImage, clip: float | None) -> tuple[float, float]:
    error = relative_errors(image[None], reference, clip)
    return float(np.mean(error**2)), float(np.mean(reference_noise(reference, clip)))


def filtered(
    _: Measured, image: Image, reference: ReferenceImage, sigma: float = SIGMA
) -> tuple[float, float]:
    """Of the clipped relative error, seen through a Gaussian."""
    error = relative_errors(image[None], reference, CLIP)[0]
    seen = ndimage.gaussian_filter(error, sigma)
    return float(np.mean(seen**2)), filtered_noise(reference, sigma)


def shares(data: Measured, images: Mapping[str, Iterable[Image]], parts: Parts) -> dict[str, float]:
    """Return what share of a measure of every variant's images is the reference's own noise."""
    reference = data.reference
    if reference is None or not reference.variance.any():
        return {}
    found = {}
    for name, own in images.items():
        pairs = [parts(data, image, reference) for image in own]
        if pairs:
            measured, noise = np.mean(pairs, axis=0)
            found[name] = float(noise) / max(float(measured), 1e-30)
    return found


def refusal(size: str, quantity: str, found: Mapping[str, float]) -> Refused | None:
    """
    Refuse a quantity of which more than half is the reference's own noise, of some variant.

    Parameters
    ----------
    size, quantity : str
        For the message.
    found : mapping of str to float
        As of `shares`.
    """
    text = excess(found)
    return Refused(f"{quantity} at {size} is not given: {text}") if text else None


def excess(found: Mapping[str, float]) -> str:
    """Say which variant needs a surer reference most, and how many samples; empty where none."""
    worst = max(found, key=found.__getitem__, default="")
    if not worst or found[worst] <= LIMIT:
        return ""
    return (
        f"{100 * found[worst]:.0f} % of the squared error of '{worst}' is the reference's own "
        f"noise; {_advice(found[worst])}"
    )


def _advice(share: float) -> str:
    """
    Say how many times the samples are enough.

    With n times the samples, share / n of what is measured now is the reference's, and 1 - share
    remains the image's.
    """
    if share >= 1.0:
        return "how many samples it needs cannot be told, since no other error is seen beside it"
    times = math.ceil(share / (1.0 - share) * (1.0 - LIMIT) / LIMIT)
    return f"give the reference {times} times the samples, or more"
