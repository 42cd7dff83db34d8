"""Error over frames and over time: single frames, and the average of all frames so far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...analysis import metrics
from ..results import Measured, ReferenceImage, Run

Values = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Curve:
    """
    Errors of one variant.

    Fields
    ------
    seconds : array, (F,)
        Median time until each frame is finished, over runs.
    single, average : array, (K, F)
        relMSE of each frame, and of the average of all frames up to it, for each run.
    """

    seconds: Values
    single: Values
    average: Values


def curves(data: Measured) -> dict[str, Curve]:
    """Compute the curves of all variants whose frames are kept; empty without a reference."""
    if data.reference is None:
        return {}
    found = {}
    for name, runs in data.runs.items():
        kept = [run for run in runs if run.load_frames is not None]
        if kept and len(kept[0].times) > 1:
            found[name] = _curve(data, kept, data.reference)
    return found


def _curve(data: Measured, runs: Sequence[Run], reference: ReferenceImage) -> Curve:
    def error(image: npt.NDArray[np.floating]) -> float:
        return metrics.trimmed_relmse(
            image,
            reference.image,
            epsilon=data.epsilon,
            trim=data.trim,
            reference_variance=reference.variance,
        )

    single, average = [], []
    for run in runs:
        frames = run.frames
        assert frames is not None
        means = np.cumsum(frames, axis=0, dtype=np.float64)
        means /= np.arange(1, len(frames) + 1)[:, None, None, None]
        single.append([error(frame) for frame in frames])
        average.append([error(mean) for mean in means])
    seconds = np.median([np.cumsum(run.times) for run in runs], axis=0)
    return Curve(seconds, np.array(single), np.array(average))


def records(curves_by_variant: dict[str, Curve], size: str) -> list[dict[str, str | float | int]]:
    """Return the curves as flat records: mean over runs, and its standard error."""
    return [
        {
            "size": size,
            "variant": name,
            "frame": frame + 1,
            "seconds": float(curve.seconds[frame]),
            "relmse": float(curve.single[:, frame].mean()),
            "relmse_error": _error(curve.single[:, frame]),
            "relmse_of_average": float(curve.average[:, frame].mean()),
            "relmse_of_average_error": _error(curve.average[:, frame]),
        }
        for name, curve in curves_by_variant.items()
        for frame in range(len(curve.seconds))
    ]


def _error(values: Values) -> float:
    return float(values.std(ddof=1) / np.sqrt(values.size)) if values.size > 1 else 0.0
