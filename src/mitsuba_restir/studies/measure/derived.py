"""Variants that are made of another one's images, as controls: a Gaussian blur."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
from scipy import ndimage, optimize

from ...analysis.images import luminance
from ..config.study import Study
from ..runs.results import Image, ReferenceImage, Run
from .frame_errors import CLIP, filtered_mse, frames_of
from .results import Measured

_WIDEST = 6.0
_STEPS = 13
_ACCURACY = 0.01
_TOLERANCE = 0.02


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
        misses its goal.
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
        sigma, error = _matching_sigma(data, data.runs[variant.of], data.reference, goal)
        if error > goal * (1.0 + _TOLERANCE):
            notes.append(
                f"'{name}' at {data.size}: no Gaussian brings the filtered MSE of '{variant.of}' "
                f"down to that of '{variant.blur_to}', {goal:.3g}; shown is the best, with "
                f"{error:.3g}"
            )
        blurs[name] = sigma
        runs[name] = [_blurred_run(run, sigma, data.reference) for run in data.runs[variant.of]]
    ordered = {name: runs[name] for name in study.variants}
    return replace(data, runs=ordered, blurs=blurs, notes=tuple(notes))


def _matching_sigma(
    data: Measured, runs: Sequence[Run], reference: ReferenceImage, goal: float
) -> tuple[float, float]:
    """
    Return the narrowest Gaussian that reaches the goal, in pixels, and its error.

    The error falls with the width until the blur of the picture itself outweighs the noise; where
    it does not fall to the goal, the Gaussian with the smallest error is returned.
    """

    def excess(sigma: float) -> float:
        return _mean_error(data, runs, reference, sigma) - goal

    widths = np.linspace(0.0, _WIDEST, _STEPS)
    excesses = [excess(0.0)]
    for below, sigma in pairwise(map(float, widths)):
        if excesses[-1] <= 0.0 or (len(excesses) > 1 and excesses[-1] > excesses[-2]):
            break
        excesses.append(excess(sigma))
        if excesses[-1] <= 0.0:
            found = float(optimize.brentq(excess, below, sigma, xtol=_ACCURACY))
            return found, goal
    best = int(np.argmin(excesses))
    if best == 0:
        return 0.0, excesses[0] + goal
    ends = (widths[best - 1], widths[min(best + 1, len(widths) - 1)])
    least = optimize.minimize_scalar(
        excess, bounds=ends, method="bounded", options={"xatol": _ACCURACY}
    )
    return float(least.x), float(least.fun) + goal


def _mean_error(
    data: Measured, runs: Sequence[Run], reference: ReferenceImage, sigma: float
) -> float:
    errors = [
        filtered_mse(_blur(frames_of(data, run), sigma, reference), reference) for run in runs
    ]
    return float(np.mean(errors))


def _blurred_run(run: Run, sigma: float, reference: ReferenceImage) -> Run:
    """Blur the images of a run; it has no times of its own."""
    load = None
    if run.load_frames is not None:
        load = partial(_blurred_frames, run, sigma, reference)
    last, mean = _blur(np.stack([run.last, run.mean]), sigma, reference)
    return Run(last, mean, np.zeros(0), load)


def _blurred_frames(run: Run, sigma: float, reference: ReferenceImage) -> Image:
    assert run.load_frames is not None
    return _blur(run.load_frames(), sigma, reference)


def _blur(frames: Image, sigma: float, reference: ReferenceImage) -> Image:
    """
    Blur frames (F, H, W, 3) whose fireflies are dimmed to where relative errors are clipped.

    A blur would else spread each of them over many pixels beyond the clip, and could only lose.
    """
    if sigma == 0.0:
        return frames
    ceiling = reference.luminance + CLIP * reference.scale
    bright = np.stack([luminance(frame) for frame in frames])
    dimmed = frames * np.minimum(ceiling / np.maximum(bright, 1e-30), 1.0)[..., None]
    blurred = ndimage.gaussian_filter(dimmed, (0.0, sigma, sigma, 0.0), mode="nearest")
    return np.asarray(blurred, dtype=np.float32)
