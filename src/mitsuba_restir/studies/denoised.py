"""Errors of denoised frames: each is denoised once and measured three ways."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..analysis import metrics
from ..analysis.denoise import denoise
from .noise import check_reference
from .results import Measured, Row, Run
from .scalars import per_run, reference_of, relmse


def denoised(data: Measured) -> Iterator[Row]:
    """RMSE, relMSE and HDR-FLIP of the last frames after OIDN's filter without guides."""
    r = reference_of(data)
    cleaned = {name: [_denoised(run) for run in runs] for name, runs in data.runs.items()}
    check_reference(data, cleaned, "denoised")
    clean = replace(data, runs=cleaned)
    yield from per_run(
        clean,
        "RMSE after OIDN",
        "",
        lambda run: metrics.rmse(run.last, r.image, reference_variance=r.variance),
    )
    yield from per_run(clean, "relMSE after OIDN", "", lambda run: relmse(data, run.last, 0.0))
    yield from per_run(
        clean, "HDR-FLIP after OIDN", "", lambda run: metrics.hdr_flip(run.last, r.image).mean
    )


def _denoised(run: Run) -> Run:
    return replace(run, last=denoise(run.last).astype(np.float32), load_frames=None)
