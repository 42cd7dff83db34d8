"""Independent runs of an integrator, and the test of their mean against a reference."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from .bias import BiasReport, batch_means, unbiasedness_test
from .modes import Mode

BATCHES = 16
"""Batches that the runs of a test are averaged into; 16 keep the critical values moderate."""

ALPHA = 1e-4
"""False-alarm rate of one test. With 300 tests in the suite, one run in 30 would fail by chance if
the seeds were not fixed; they are, so a test that passes stays passing."""

BLOCKS: tuple[int | None, ...] = (4, 16, None)
"""Units of the tests: single pixels are too far from Gaussian at these sample counts."""

FAILURES = Path(__file__).resolve().parents[2] / "out" / "test-failures"


def integrator(max_depth: int, mode: Mode, **extra: Any) -> Any:
    return mi.load_dict({"type": "restir_pt", "max_depth": max_depth, **mode.parameters, **extra})


def independent_runs(
    renderer: Any,
    scene: mi.Scene,
    mode: Mode,
    before_frame: Callable[[int], Any] | None = None,
    first_seed: int = 0,
) -> Iterator[np.ndarray]:
    """Last frames of independent runs, for ever.

    ``before_frame(t)`` may edit the scene or the camera before frame t; it may return the sensor
    to render from.
    """
    for run in itertools.count(first_seed):
        if mode.parameters.get("temporal", True):
            renderer.reset()
        for t in range(mode.frames):
            sensor = before_frame(t) if before_frame else None
            image = renderer.render(scene, sensor=sensor or 0, seed=run, spp=mode.spp)
        yield np.array(image, dtype=np.float64)[..., :3]


def bias_report(
    runs: Iterator[np.ndarray],
    count: int,
    reference: np.ndarray,
    variance: Any = 0.0,
    blocks: tuple[int | None, ...] = BLOCKS,
) -> BiasReport:
    """Test of the mean of ``count`` runs."""
    stack = batch_means(itertools.islice(runs, count), count // BATCHES)
    return unbiasedness_test(stack, reference, variance, blocks=blocks, alpha=ALPHA, floor=3e-5)


def assert_unbiased(report: BiasReport, name: str, power: float) -> None:
    """Fail with images if the runs are biased, or if a bias of ``power`` could have been missed."""
    print(f"{name}: finds {report.detectable:.3%}")
    if not report.passed:
        report.write(FAILURES / f"{name}.npz")
    assert report.passed, f"{name} ({FAILURES / name}.npz)\n{report}"
    assert report.detectable < power, f"{name} has too little power\n{report}"
