"""Variants that are made of another one's images, as controls: a Gaussian blur."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy import ndimage, optimize

from .config import Study
from .frame_errors import filtered_mse, frames_of
from .results import Image, Measured, ReferenceImage, Run

_WIDEST = 6.0
_STEPS = 13
_ACCURACY = 0.01


def with_derived(study: Study, data: Measured) -> Measured:
    """
    Add the variants of a study that are made of others.

    Parameters
    ----------
    study : Study
    data : Measured
        The rendered variants and the reference.

    Returns
    -------
    Measured
        With their runs, the standard deviation in pixels of every blur, and a note for each that
        does not exist.
    """
    runs, blurs, notes = dict(data.runs), dict(data.blurs), list(data.notes)
    for name, variant in study.variants.items():
        if not variant.of:
            continue
        assert data.reference is not None
        runs[name] = []
        if not (data.runs[variant.of] and data.runs[variant.blur_to]):
            continue
        goal = _mean_error(data, data.runs[variant.blur_to], data.reference, 0.0)
        sigma = _matching_sigma(data, data.runs[variant.of], data.reference, goal)
        if sigma is None:
            notes.append(
                f"'{name}' at {data.size} is not given: no Gaussian brings the filtered MSE of "
                f"'{variant.of}' down to that of '{variant.blur_to}', {goal:.3g}"
            )
            continue
        blurs[name] = sigma
        runs[name] = [_blurred_run(run, sigma) for run in data.runs[variant.of]]
    ordered = {name: runs[name] for name in study.variants}
    return replace(data, runs=ordered, blurs=blurs, notes=tuple(notes))


def _matching_sigma(
    data: Measured, runs: Sequence[Run], reference: ReferenceImage, goal: float
) -> float | None:
    """
    Return the narrowest Gaussian that reaches the goal, in pixels; None where none does.

    The error falls with the width until the blur of the picture itself outweighs the noise.
    """

    def excess(sigma: float) -> float:
        return _mean_error(data, runs, reference, sigma) - goal

    below, before = 0.0, excess(0.0)
    if before <= 0.0:
        return 0.0
    for sigma in np.linspace(0.0, _WIDEST, _STEPS)[1:]:
        after = excess(float(sigma))
        if after <= 0.0:
            return float(optimize.brentq(excess, below, float(sigma), xtol=_ACCURACY))
        if after > before:
            return None
        below, before = float(sigma), after
    return None


def _mean_error(
    data: Measured, runs: Sequence[Run], reference: ReferenceImage, sigma: float
) -> float:
    errors = [filtered_mse(_blur(frames_of(data, run), sigma), reference) for run in runs]
    return float(np.mean(errors))


def _blurred_run(run: Run, sigma: float) -> Run:
    """Blur the images of a run; it has no times of its own."""
    load = None
    if run.load_frames is not None:
        load = partial(_blurred_frames, run, sigma)
    last, mean = _blur(np.stack([run.last, run.mean]), sigma)
    return Run(last, mean, np.zeros(0), load)


def _blurred_frames(run: Run, sigma: float) -> Image:
    assert run.load_frames is not None
    return _blur(run.load_frames(), sigma)


def _blur(frames: Image, sigma: float) -> Image:
    if sigma == 0.0:
        return frames
    blurred = ndimage.gaussian_filter(frames, (0.0, sigma, sigma, 0.0), mode="nearest")
    return np.asarray(blurred, dtype=np.float32)
