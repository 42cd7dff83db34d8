"""Errors of denoised frames: each is denoised once and measured three ways."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ...analysis.denoise import denoise
from ..runs.results import Image, Run
from . import noise
from .frame_errors import last_frame_of
from .results import Measured, Refused, Row
from .scalars import Measure, hdr_flip, of_frames, rmse, whole_relmse


def denoised(data: Measured) -> Iterator[Row | Refused]:
    """RMSE, relMSE and HDR-FLIP of the last frame of a run after OIDN's filter without guides."""
    runs = {name: [_denoised(data, run) for run in runs] for name, runs in data.runs.items()}
    clean = replace(data, runs=runs)
    measures: Sequence[tuple[str, Measure, noise.Parts]] = (
        ("RMSE", rmse, noise.absolute),
        ("relMSE", whole_relmse, noise.relmse),
        ("HDR-FLIP", hdr_flip, noise.clipped),
    )
    for name, measure, parts in measures:
        yield from of_frames(f"{name} after OIDN", measure, parts)(clean)


def _denoised(data: Measured, run: Run) -> Run:
    frames = [denoise(frame).astype(np.float32) for frame in last_frame_of(data, run)]
    return replace(run, last=frames[-1], load_frames=partial(_stack, frames))


def _stack(frames: Sequence[Image]) -> Image:
    return np.stack(frames)
