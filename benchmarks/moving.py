"""What moves: how often history is found, error for its time, and bias, with intervals of 95 %.

The scene comes to rest, in the last frame, where the file has it, and that frame of many runs is
compared with `path`. Three ways to treat the history of a scene that has changed, beside the one
that is used: ``surfaces not followed`` re-projects what moves as if it stood still (unbiased);
``not looked back`` weighs the history by the scene after the change (`retrace_history` where the
integrator is not told of edits: too dark); ``not traced again`` takes it as it is.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any
from unittest import mock

import mitsuba as mi
import numpy as np
import numpy.typing as npt

from mitsuba_restir import scenes, sequence
from mitsuba_restir.analysis.images import luminance
from mitsuba_restir.analysis.intervals import Interval, mean_interval, with_known_error
from mitsuba_restir.analysis.metrics import trimmed_relmse
from mitsuba_restir.integrators import frame as frames_of
from mitsuba_restir.neighbors.reproject import reproject
from mitsuba_restir.paths.grid import grid_of
from mitsuba_restir.sequence.change import Watched

SCENE, SIZE, DEPTH, FRAMES = "cornell", (96, 96), 6, 8
REST = FRAMES - 1
MIXED = {"mutations": 2, "guiding": True}
BATCH = 16
"""Samples per pixel of one picture of the reference."""


def _track(name: str, **first: Any) -> dict[str, Any]:
    """From somewhere to where the scene has it."""
    return {"parameter": name, "keyframes": [{"frame": 0, **first}, {"frame": REST}]}


OBJECT = [
    _track("tall_block.to_world", translate=[0.4, 0, 0.4], rotate={"axis": [0, 1, 0], "angle": 60}),
    _track("low_block.to_world", translate=[-0.4, 0.4, 0]),
]
SLOW = [
    _track("tall_block.to_world", translate=[0.1, 0, 0.1], rotate={"axis": [0, 1, 0], "angle": 15}),
    _track("low_block.to_world", translate=[-0.1, 0.1, 0]),
]
LIGHT = [_track("light.to_world", translate=[0.5, -0.2, 0.3])]
CAMERA = [_track("sensor.to_world", translate=[0.3, 0.1, 0.2])]

CASES: dict[str, tuple[list[Any], dict[str, Any]]] = {
    "object": (OBJECT, {}),
    "slow object": (SLOW, {}),
    "light": (LIGHT, {}),
    "camera": (CAMERA, {}),
    "all, with mutations and guiding": (OBJECT + LIGHT + CAMERA, MIXED),
}

Patch = tuple[Any, str, Any]


def _standing(*arguments: Any) -> Any:
    grid, now, hits, camera, moves = arguments
    there = reproject(grid, now, hits, camera, moves)
    return replace(reproject(grid, now, hits, camera, None), moved=there.moved, lost=there.lost)


WAYS: dict[str, tuple[list[Patch], dict[str, Any]]] = {
    "followed": ([], {}),
    "surfaces not followed": ([(frames_of, "reproject", _standing)], {}),
    "not looked back": ([(Watched, "change", lambda _: None)], {}),
    "not traced again": ([], {"retrace_history": False}),
}
"""How the history is treated: what is replaced for it, and parameters."""


@dataclass(frozen=True)
class Found:
    """
    What the last frames of the runs are.

    Fields
    ------
    images : array, (R, H, W, 3)
    moved : array, (H, W)
        Pixels whose surface has moved, in the last frame of any run.
    matched : float
        Share of the pixels with a moving surface that found their history; NaN without any.
    seconds : array, (R,)
        For a frame, the median of a run.
    """

    images: npt.NDArray[np.float64]
    moved: npt.NDArray[np.bool_]
    matched: float
    seconds: npt.NDArray[np.float64]


def measure(tracks: list[Any], parameters: dict[str, Any], way: str, runs: int) -> Found:
    """Render the runs of a case."""
    patches, more = WAYS[way]
    scene = scenes.load(SCENE, *SIZE)
    update = sequence.from_data({"interpolation": "linear", "tracks": tracks}).bind(scene)
    images, matched, seconds = [], [], []
    moved = np.zeros(SIZE[0] * SIZE[1], dtype=bool)
    with ExitStack() as stack:
        for patch in patches:
            stack.enter_context(mock.patch.object(*patch))
        settings = {"retrace_history": update.edits_scene, **parameters, **more}
        integrator = mi.load_dict({"type": "restir_pt", "max_depth": DEPTH, **settings})
        # The first run compiles.
        for seed in range(-1, runs):
            integrator.reset()
            shot = sequence.Shot(scene, scene.sensors()[0], integrator, update, 1, max(seed, 0))
            times = []
            for index in range(FRAMES):
                start = time.perf_counter()
                image = shot.image(index)
                times.append(time.perf_counter() - start)
            if seed >= 0:
                images.append(image.astype(np.float64))
                seconds.append(np.median(times[2:]))
                moved |= np.array(integrator.frame.found.moved)
                matched.append(integrator.statistics().get("moving", {}).get("matched", np.nan))
    return Found(
        np.stack(images), grid_of(*SIZE).image(moved), float(np.mean(matched)), np.array(seconds)
    )


def reference(spp: int) -> npt.NDArray[np.float64]:
    """Pictures of the scene at rest by `path`, each with :data:`BATCH` samples per pixel."""
    scene = scenes.load(SCENE, *SIZE)
    path = mi.load_dict({"type": "path", "max_depth": DEPTH, "rr_depth": 1000})
    pictures = (
        np.array(mi.render(scene, integrator=path, spp=BATCH, seed=seed), dtype=np.float64)
        for seed in range(max(2, spp // BATCH))
    )
    return np.stack([picture[..., :3] for picture in pictures])


def bias(images: npt.NDArray[np.float64], truth: npt.NDArray[np.float64]) -> Interval:
    """Of the mean luminance, relative to the reference, whose own error is part of it."""
    known = np.array([luminance(picture).mean() for picture in truth])
    means = np.array([luminance(image).mean() for image in images]) / known.mean()
    error = known.std(ddof=1) / np.sqrt(len(known)) / known.mean()
    return with_known_error(mean_interval(means), len(means), float(error))


def errors_of(
    images: npt.NDArray[np.float64],
    mean: npt.NDArray[np.float64],
    noise: npt.NDArray[np.float64],
    where: npt.NDArray[np.bool_],
) -> list[float]:
    """Trimmed relMSE of each image, over some of its pixels."""
    known, variance = mean[where][None], noise[where][None]
    return [
        trimmed_relmse(image[where][None], known, reference_variance=variance) for image in images
    ]


def lines(runs: int, spp: int) -> Iterator[str]:
    """The report, line by line."""
    truth = reference(spp)
    mean, noise = truth.mean(axis=0), truth.var(axis=0, ddof=1) / len(truth)
    yield f"{SCENE} {SIZE[0]}x{SIZE[1]}, {FRAMES} frames, {runs} runs; reference {spp} spp"
    for case, (tracks, parameters) in CASES.items():
        baseline: float | None = None
        moving: npt.NDArray[np.bool_] | None = None
        for way in WAYS:
            if case == "camera" and way != "followed":
                continue
            found = measure(tracks, parameters, way, runs)
            errors = errors_of(found.images, mean, noise, np.ones_like(found.moved))
            cost = float(np.mean(errors) * np.mean(found.seconds))
            baseline = baseline or cost
            yield (
                f"{case}; {way}: matched {found.matched:.3f}, mean/reference "
                f"{bias(found.images, truth)}, relMSE trimmed {mean_interval(errors)}, "
                f"{1e3 * np.mean(found.seconds):.1f} ms, error x time {cost / baseline:.2f}"
            )
            moving = found.moved if moving is None else moving
            if moving.any():
                there = errors_of(found.images, mean, noise, moving)
                yield f"    on what moves ({moving.mean():.0%}): {mean_interval(there)}"


def main(show: Callable[[str], None] = print) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.moving", description=__doc__)
    parser.add_argument("--runs", type=int, default=200, help="of each case and way (200)")
    parser.add_argument("--spp", type=int, default=16384, help="of the reference (16384)")
    options = parser.parse_args()
    mi.set_variant("cuda_ad_rgb", "llvm_ad_rgb")
    for line in lines(options.runs, options.spp):
        show(line)
    return 0


if __name__ == "__main__":
    sys.exit(main())
