"""Errors of denoised frames: each is denoised once and measured three ways."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ..analysis import metrics
from ..analysis.denoise import denoise
from .frame_errors import last_frame_of
from .noise import check_reference
from .results import Image, Measured, Row, Run
from .scalars import of_frames, relmse


def denoised(data: Measured) -> Iterator[Row]:
    """RMSE, relMSE and HDR-FLIP of the last frame of a run after OIDN's filter without guides."""
    runs = {name: [_denoised(data, run) for run in runs] for name, runs in data.runs.items()}
    check_reference(data, runs, "denoised")
    clean = replace(data, runs=runs)
    measures = {
        "RMSE": lambda _, image, r: metrics.rmse(image, r.image, reference_variance=r.variance),
        "relMSE": lambda data, image, _: relmse(data, image, 0.0),
        "HDR-FLIP": lambda _, image, r: metrics.hdr_flip(image, r.image).mean,
    }
    for name, measure in measures.items():
        yield from of_frames(f"{name} after OIDN", measure)(clean)


def _denoised(data: Measured, run: Run) -> Run:
    frames = [denoise(frame).astype(np.float32) for frame in last_frame_of(data, run)]
    return replace(run, last=frames[-1], load_frames=partial(_stack, frames))


def _stack(frames: Sequence[Image]) -> Image:
    return np.stack(frames)
