"""How good stills are for their time, beside path: efficiency, stated error, and both denoised.

`efficiency`: how many times longer `path` takes for the same variance: variance x time of frames of
`path` over that of stills, pilot included. Variances are relative to the picture squared: mean over
all pixels, without the largest 0.1 %, and of the median pixel. What a still is off by is the spread
of several; their mean stands for the truth.

`stated`: the error that stills of several targets state, over that by which they are off.

`denoised`: how many times longer `path` and the denoiser take for what a denoised still is off by,
by relMSE without the worst 0.1 % and by HDR-FLIP. Between the times of `path`, and beyond them, the
logarithm of the error is taken to be linear in that of the time.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import numpy.typing as npt

from mitsuba_restir import still
from mitsuba_restir.analysis.denoise import denoise_guided
from mitsuba_restir.analysis.images import luminance
from mitsuba_restir.analysis.metrics import (
    DEFAULT_EPSILON,
    hdr_flip,
    trimmed_mean,
    trimmed_relmse,
)
from mitsuba_restir.errors import RenderError, UsageError
from mitsuba_restir.imageio import Image, with_rgb
from mitsuba_restir.still.error import FLOOR
from mitsuba_restir.studies import load_study
from mitsuba_restir.studies.config.adapt import adapt
from mitsuba_restir.studies.runs.rendering import denoiser_guides, make_sensor
from mitsuba_restir.studies.runs.scene import load_scene

FRAMES = 64
"""Frames of `path` whose variance is measured."""

LONGER = 3
"""How many times the longest still's time `path` is given."""

Array = npt.NDArray[np.float64]

Say = Callable[[dict[str, Any]], None]
"""Takes what has been found, as soon as it is."""


@dataclass(frozen=True)
class Subject:
    """What is rendered, and what `path` and stills have in common."""

    scene: Any
    sensor: Any
    max_depth: int
    seed: int


@dataclass(frozen=True)
class Truth:
    """The mean of several stills, (H, W, 3), and the variance of it."""

    image: Array
    variance: Array


def moments(images: Sequence[Image]) -> tuple[Array, Array]:
    """Mean and variance of an image."""
    values = np.stack(images).astype(np.float64)
    return values.mean(axis=0), values.var(axis=0, ddof=1)


def three(variance: Array, mean: Array) -> Array:
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


def stills(subject: Subject, count: int, **goal: Any) -> list[still.Still]:
    """Independent stills, each with a pilot of its own; the kernels are compiled before."""

    def render(seed: int, **goal: Any) -> still.Still:
        return still.render(
            subject.scene, subject.sensor, max_depth=subject.max_depth, seed=seed, **goal
        )

    render(subject.seed, **{**goal, "error": None, "seconds": 1.0})
    return [render(subject.seed + 1 + index, **goal) for index in range(count)]


def plans(pictures: Sequence[still.Still]) -> list[str]:
    """What was chosen for each, and why."""
    return [f"{each.plan.name}, {each.frames} frames: {each.why}" for each in pictures]


def efficiency(subject: Subject, seconds: Sequence[float], count: int, say: Say) -> None:
    """Measure how many times longer `path` takes for the same variance."""
    frames, pace = path_frames(subject, 1, FRAMES)
    _, of_path = moments(frames)
    for budget in seconds:
        plain = stills(subject, count, seconds=budget)
        mean, variance = moments([each.image for each in plain])
        took = float(np.mean([each.seconds for each in plain]))
        every, trimmed, median = three(of_path, mean) * pace / (three(variance, mean) * took)
        say(
            {
                "seconds": took,
                "efficiency": every,
                "trimmed": trimmed,
                "median pixel": median,
                "frame of path": pace,
                "plans": plans(plain),
            }
        )


def stated(subject: Subject, targets: Sequence[float], count: int, say: Say) -> None:
    """Measure what stills of several targets are off by, beside what they state."""
    for target in targets:
        pictures = stills(subject, count, error=target)
        mean, variance = moments([each.image for each in pictures])
        relative = variance / (mean**2 + (FLOOR * luminance(mean).mean()) ** 2)
        errors = np.array([[each.error, each.untrimmed] for each in pictures])
        says = np.sqrt((errors**2).mean(axis=0))
        true = np.sqrt([trimmed_mean(relative), relative.mean()])
        say(
            {
                "target": target,
                "seconds": float(np.mean([each.seconds for each in pictures])),
                "stated": says[0],
                "true": true[0],
                "stated over true": says[0] / true[0],
                "untrimmed": says[1] / true[1],
                "plans": plans(pictures)[:1],
            }
        )


def denoised(subject: Subject, seconds: Sequence[float], count: int, say: Say) -> None:
    """Measure denoised stills, and how long `path` takes to be as good."""
    mean, variance = moments([s.image for s in stills(subject, count, seconds=max(seconds))])
    truth = Truth(mean, variance / count)
    guides = denoiser_guides(subject.scene, subject.sensor)
    _, slow = path_frames(subject, 16, 1)
    curve = []
    for budget in (*seconds, LONGER * max(seconds)):
        frames, took = path_frames(subject, max(1, round(16 * budget / slow)), 1)
        curve.append((took, *_errors([denoise_guided(frame, *guides) for frame in frames], truth)))
        say({"path": took, "relMSE trimmed": curve[-1][1], "HDR-FLIP": curve[-1][2]})
    for budget in seconds:
        planned = stills(subject, count, seconds=budget, denoise=True)
        took = float(np.mean([each.seconds for each in planned]))
        errors = _errors([each.denoised for each in planned if each.denoised is not None], truth)
        relmse, flip = (as_long(np.array(curve)[:, [0, i + 1]], errors[i]) for i in range(2))
        say(
            {
                "still --denoise": took,
                "relMSE trimmed": errors[0],
                "HDR-FLIP": errors[1],
                "path takes, by relMSE": relmse / took,
                "path takes, by HDR-FLIP": flip / took,
                "plans": plans(planned),
            }
        )


def as_long(curve: Array, error: float) -> float:
    """The time at which a curve of (time, error), (N, 2), has an error [s]."""
    times, errors = np.log(curve[np.argsort(curve[:, 0])]).T
    falls = np.minimum.accumulate(errors)
    # The segment in which the error lies; the first or the last one where it is beyond.
    i = int(np.clip(np.searchsorted(-falls, -np.log(error)), 1, len(times) - 1))
    slope = (falls[i] - falls[i - 1]) / (times[i] - times[i - 1])
    if not slope < 0:
        return float("nan")
    return float(np.exp(times[i] + (np.log(error) - falls[i]) / slope))


def _errors(images: Sequence[Image], truth: Truth) -> tuple[float, float]:
    relmse = [
        trimmed_relmse(image, truth.image, reference_variance=truth.variance) for image in images
    ]
    return float(np.mean(relmse)), float(np.mean([hdr_flip(i, truth.image) for i in images]))


MEASURES = {"efficiency": efficiency, "stated": stated, "denoised": denoised}


def _say(path: Path | None, about: dict[str, Any], found: dict[str, Any]) -> None:
    """Print what has been found and, where there is a file, add it to it."""
    print(", ".join(f"{k} {v:.4g}" for k, v in found.items() if isinstance(v, float)), flush=True)
    for plan in found.get("plans", ()):
        print(f"    {plan}", flush=True)
    if path is not None:
        with path.open("a") as file:
            file.write(json.dumps({**about, **found}) + "\n")


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.stills", description=__doc__)
    parser.add_argument("study", metavar="STUDY", help="whose scene and view are rendered")
    parser.add_argument("--scene", help="another scene")
    parser.add_argument("--measure", choices=MEASURES, default="efficiency")
    parser.add_argument(
        "--seconds", type=float, nargs="+", default=[10.0], help="for each picture (10)"
    )
    parser.add_argument(
        "--errors", type=float, nargs="+", default=[0.1], help="targets of `stated` (0.1)"
    )
    parser.add_argument("--pictures", type=int, default=3, help="how many stills of each (3)")
    parser.add_argument("--size", type=int, nargs=2, metavar=("W", "H"), help="pixels")
    parser.add_argument("-o", "--output", type=Path, help="file that a line of JSON is added to")
    return parser


def main() -> int:
    """Run the command; 0 where all was measured."""
    options = _arguments().parse_args()
    goals = options.errors if options.measure == "stated" else options.seconds
    try:
        study = adapt(load_study(options.study), options.scene, small=False)
        mi.set_variant(study.mitsuba_variant)
        scene = load_scene(study)
        size = tuple(options.size) if options.size else study.sizes[0]
        subject = Subject(scene, make_sensor(study, scene, size), study.max_depth, study.seed)
        about = {"study": study.name, "scene": study.scene, "size": size}
        say = partial(_say, options.output, {**about, "measure": options.measure})
        MEASURES[options.measure](subject, goals, options.pictures, say)
    except (UsageError, RenderError) as error:
        print(f"benchmarks.stills: {error}", file=sys.stderr)
        return 2 if isinstance(error, UsageError) else 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
