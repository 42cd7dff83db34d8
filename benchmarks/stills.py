"""How good stills are for their time, beside path: efficiency, stated error, and both denoised.

Efficiency is how many times longer `path` takes for the same variance: variance x time of frames of
`path` over that of stills, pilot included. Variances are relative to the picture squared: mean over
all pixels, without the largest 0.1 %, and of the median pixel. What a still is off by is the spread
of several; their mean stands for the truth.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass
from typing import Any

import mitsuba as mi
import numpy as np
import numpy.typing as npt

from mitsuba_restir import still
from mitsuba_restir.analysis.denoise import denoise_guided
from mitsuba_restir.analysis.images import luminance
from mitsuba_restir.analysis.metrics import DEFAULT_EPSILON, trimmed_mean, trimmed_relmse
from mitsuba_restir.errors import RenderError, UsageError
from mitsuba_restir.imageio import Image, with_rgb
from mitsuba_restir.still.error import FLOOR
from mitsuba_restir.studies import load_study
from mitsuba_restir.studies.config.adapt import adapt
from mitsuba_restir.studies.runs.rendering import denoiser_guides, make_sensor
from mitsuba_restir.studies.runs.scene import load_scene

FRAMES = 64
"""Frames of `path` whose variance is measured."""


@dataclass(frozen=True)
class Subject:
    """What is rendered, and what `path` and stills have in common."""

    scene: Any
    sensor: Any
    max_depth: int
    seed: int


def moments(images: list[Image]) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Mean and variance of an image."""
    values = np.stack(images).astype(np.float64)
    return values.mean(axis=0), values.var(axis=0, ddof=1)


def three(variance: npt.NDArray[np.float64], mean: npt.NDArray[np.float64]) -> npt.NDArray[Any]:
    """Relative variance: all pixels, without the worst 0.1 %, median pixel."""
    relative = variance / (mean**2 + DEFAULT_EPSILON)
    median = float(np.median(relative.mean(axis=2)))
    return np.array([relative.mean(), trimmed_mean(relative), median])


def path_frames(subject: Subject, spp: int, count: int) -> tuple[list[Image], float]:
    """Frames of `path`, and the median time of one [s]."""
    integrator = mi.load_dict({"type": "path", "max_depth": subject.max_depth})

    def render(seed: int) -> Image:
        film = mi.render(
            subject.scene, integrator=integrator, sensor=subject.sensor, spp=spp, seed=seed
        )
        return with_rgb(film, 0)

    render(subject.seed)
    frames, times = [], []
    for index in range(count):
        begin = time.perf_counter()
        frames.append(render(subject.seed + 1 + index))
        times.append(time.perf_counter() - begin)
    return frames, float(np.median(times))


def stills(subject: Subject, seconds: float, count: int, denoise: bool) -> list[still.Still]:
    """Independent stills, each with a pilot of its own; the kernels are compiled before."""

    def render(seed: int, budget: float) -> still.Still:
        return still.render(
            subject.scene,
            subject.sensor,
            max_depth=subject.max_depth,
            seconds=budget,
            denoise=denoise,
            seed=seed,
        )

    render(subject.seed, 1.0)
    return [render(subject.seed + 1 + index, seconds) for index in range(count)]


def report(subject: Subject, seconds: float, count: int) -> None:
    """Measure, and print."""
    frames, pace = path_frames(subject, 1, FRAMES)
    _, path_variance = moments(frames)
    plain = stills(subject, seconds, count, denoise=False)
    mean, variance = moments([each.image for each in plain])
    took = float(np.mean([each.seconds for each in plain]))
    gains = three(path_variance, mean) * pace / (three(variance, mean) * took)
    print("plans:", ", ".join(f"{each.plan.name} ({each.frames} frames)" for each in plain))
    print("why:", plain[0].why)
    print(f"stills of {took:.2f} s, frame of path {1e3 * pace:.1f} ms")
    print("efficiency, all pixels {:.3g}, trimmed {:.3g}, median pixel {:.3g}".format(*gains))
    stated = np.sqrt(np.mean([each.error**2 for each in plain]))
    true = variance / (mean**2 + (FLOOR * luminance(mean).mean()) ** 2)
    print(f"stated error {stated:.4g}, true {np.sqrt(trimmed_mean(true)):.4g}")

    planned = stills(subject, seconds, 2, denoise=True)
    denoised = [each.denoised for each in planned if each.denoised is not None]
    print("plans, denoised:", ", ".join(f"{each.plan.name}" for each in planned))
    _, slow = path_frames(subject, 16, 2)
    samples = max(1, round(16 * seconds / slow))
    frames, spent = path_frames(subject, samples, 2)
    guides = denoiser_guides(subject.scene, subject.sensor)
    clean = [denoise_guided(frame, *guides) for frame in frames]
    for name, images, took in (
        ("still --denoise", denoised, float(np.mean([each.seconds for each in planned]))),
        (f"path, {samples} samples, denoised", clean, spent),
    ):
        errors = [
            trimmed_relmse(image, mean, reference_variance=variance / count) for image in images
        ]
        print(f"{name}: {took:.2f} s, relMSE trimmed {np.mean(errors):.4g} of {errors}")


def main() -> int:
    """Run the command; 0 where all was measured."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.stills", description=__doc__)
    parser.add_argument("study", metavar="STUDY", help="whose scene and view are rendered")
    parser.add_argument("--scene", help="another scene")
    parser.add_argument("--seconds", type=float, default=10.0, help="for each picture (10)")
    parser.add_argument("--pictures", type=int, default=3, help="how many stills (3)")
    options = parser.parse_args()
    try:
        study = load_study(options.study)
        study = adapt(study, options.scene, small=False)
        mi.set_variant(study.mitsuba_variant)
        scene = load_scene(study)
        sensor = make_sensor(study, scene, study.sizes[0])
        subject = Subject(scene, sensor, study.max_depth, study.seed)
        report(subject, options.seconds, options.pictures)
    except (UsageError, RenderError) as error:
        print(f"benchmarks.stills: {error}", file=sys.stderr)
        return 2 if isinstance(error, UsageError) else 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
