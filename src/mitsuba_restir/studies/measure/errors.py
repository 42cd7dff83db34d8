"""Quantities that are one error of each run: the mean over its frames, or that of their mean."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from ...analysis import metrics
from ...analysis.denoise import denoise
from ..runs.results import Image, ReferenceImage, Run
from . import noise
from .frame_errors import filtered_mse, frames_of, last_frame_of
from .noise import Parts, shares
from .results import Measure, Measured, Number, Refused, Row, Rows
from .rows import per_run, reference_of, unless_noisy


def of_frames(
    measure: Measure,
    parts: Parts,
    frames: Callable[[Measured, Run], Image] = frames_of,
    judged: Callable[[Run], Image] = lambda run: run.last,
) -> Rows:
    """
    Make a quantity of one number of each run: the mean over its frames.

    Parameters
    ----------
    measure : callable
        Measures a frame.
    parts : callable
        Of an image of a run, what is measured and what of it is the reference's own noise.
    frames : callable
        Chooses the frames.
    judged : callable
        Chooses the image.
    """

    def rows(data: Measured, numbers: Sequence[Number]) -> Iterator[Row | Refused]:
        (number,) = numbers
        reference = reference_of(data)
        images = {name: [judged(run) for run in runs] for name, runs in data.runs.items()}

        def measure_run(run: Run) -> float:
            return float(np.mean([measure(data, image, reference) for image in frames(data, run)]))

        found = shares(data, images, parts)
        yield from unless_noisy(data, number.name, found, per_run(data, number, measure_run))

    return rows


def of_mean(measure: Measure, parts: Parts) -> Rows:
    """Make a quantity of the mean of all measured frames of each run; arguments as `of_frames`."""
    return of_frames(measure, parts, lambda _, run: run.mean[None], lambda run: run.mean)


def one_by_one(*quantities: Rows) -> Rows:
    """Make a quantity of others that give one number each."""

    def rows(data: Measured, numbers: Sequence[Number]) -> Iterator[Row | Refused]:
        for quantity, number in zip(quantities, numbers, strict=True):
            yield from quantity(data, [number])

    return rows


def after_denoising(
    quantity: Rows, frames: Callable[[Measured, Run], Image] = last_frame_of
) -> Rows:
    """
    Make a quantity of frames of every run after OIDN's filter without guides.

    Parameters
    ----------
    frames : callable
        Chooses the frames.
    """

    def rows(data: Measured, numbers: Sequence[Number]) -> Iterator[Row | Refused]:
        runs = {
            name: [_denoised(run, frames(data, run)) for run in own]
            for name, own in data.runs.items()
        }
        yield from quantity(replace(data, runs=runs), numbers)

    return rows


def of_averages(quantity: Rows) -> Rows:
    """Make a quantity of the mean of all measured frames of every run."""

    def rows(data: Measured, numbers: Sequence[Number]) -> Iterator[Row | Refused]:
        runs = {
            name: [replace(run, last=run.mean, load_frames=None) for run in own]
            for name, own in data.runs.items()
        }
        yield from quantity(replace(data, runs=runs), numbers)

    return rows


def _denoised(run: Run, frames: Image) -> Run:
    clean = np.stack([denoise(frame).astype(np.float32) for frame in frames])
    return replace(run, last=clean[-1], load_frames=partial(np.asarray, clean))


def means_of(data: Measured) -> dict[str, list[Image]]:
    """Return the mean of all frames of every run, by variant."""
    return {name: [run.mean for run in runs] for name, runs in data.runs.items()}


def relmse(data: Measured, image: ArrayLike, trim: float) -> float:
    """Relative mean squared error with the study's epsilon and the reference's own variance."""
    reference = reference_of(data)
    return metrics.trimmed_relmse(
        image,
        reference.image,
        epsilon=data.epsilon,
        trim=trim,
        reference_variance=reference.variance,
    )


def whole_relmse(data: Measured, image: Image, _: ReferenceImage) -> float:
    """relMSE of all pixels; a `Measure`, as all that follow."""
    return relmse(data, image, 0.0)


def trimmed_relmse(data: Measured, image: Image, _: ReferenceImage) -> float:
    """relMSE without the worst pixels."""
    return relmse(data, image, data.trim)


def rmse(_: Measured, image: Image, reference: ReferenceImage) -> float:
    """RMSE without the reference's own variance."""
    return metrics.rmse(image, reference.image, reference_variance=reference.variance)


def rmse_displayed(_: Measured, image: Image, reference: ReferenceImage) -> float:
    """RMSE as a screen shows it, without the reference's own variance."""
    return metrics.rmse(
        metrics.displayed(image),
        metrics.displayed(reference.image),
        reference_variance=metrics.displayed_variance(reference.image, reference.variance),
    )


def rmse_relative(data: Measured, image: Image, reference: ReferenceImage) -> float:
    """Root mean squared relative error of luminance, without the reference's own noise."""
    square, own = noise.relative(data, image, reference)
    return float(np.sqrt(max(square - own, 0.0)))


def rmse_clipped(data: Measured, image: Image, reference: ReferenceImage) -> float:
    """The same of errors that are clipped at +-4."""
    square, own = noise.clipped(data, image, reference)
    return float(np.sqrt(max(square - own, 0.0)))


def seen_through(sigma: float) -> Rows:
    """Make a quantity of the clipped relative error seen through a Gaussian of so many pixels."""

    def filtered(_: Measured, image: Image, reference: ReferenceImage) -> float:
        return filtered_mse(image[None], reference, sigma)

    return of_frames(filtered, partial(noise.filtered, sigma=sigma))


def smape(_: Measured, image: Image, reference: ReferenceImage) -> float:
    """Symmetric mean absolute error."""
    return metrics.smape(image, reference.image)


def hdr_flip(_: Measured, image: Image, reference: ReferenceImage) -> float:
    """Mean HDR-FLIP."""
    return metrics.hdr_flip(image, reference.image)


denoised = after_denoising(
    one_by_one(
        of_frames(rmse, noise.absolute),
        of_frames(whole_relmse, noise.relmse),
        of_frames(hdr_flip, noise.clipped),
    )
)
"""RMSE, relMSE and HDR-FLIP: each frame is denoised once and measured three ways."""

averages = of_averages(
    one_by_one(
        of_frames(trimmed_relmse, noise.trimmed),
        after_denoising(of_frames(whole_relmse, noise.relmse)),
    )
)
"""relMSE of the mean of all frames, trimmed, and of all pixels after OIDN."""
