"""How the time of a frame grows with pixels, trees, neighbours, rounds and depth.

    python docs/growth.py    # writes docs/figures/growth.png and growth.csv

Frames of the embedded room, with one thing changed at a time; all take turns, so that a busy
machine slows all of them. Medians, relative to the same frame with nothing changed.
"""

# mitsuba_restir brings the LLVM, and comes before mitsuba.
# ruff: noqa: I001

from __future__ import annotations

import csv
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mitsuba_restir import scenes
import drjit as dr
import mitsuba as mi
from matplotlib.figure import Figure

HERE = Path(__file__).parent / "figures"
WARM_UP, FRAMES = 5, 15
USUAL = {
    "pixels": 144,
    "spp": 1,
    "spatial_neighbors": 3,
    "spatial_rounds": 1,
    "max_depth": 10,
}
"""Lines of an image with 16:9, candidate trees, and parameters of the integrator."""

CHANGED = {
    "pixels": (72, 144, 288, 432),
    "spp": (1, 2, 4, 8),
    "spatial_neighbors": (1, 3, 6, 12),
    "spatial_rounds": (0, 1, 2, 4),
    "max_depth": (2, 5, 10, 20),
}
LABELS = {
    "pixels": "lines of pixels",
    "spp": "trees (spp)",
    "spatial_neighbors": "neighbours",
    "spatial_rounds": "rounds",
    "max_depth": "depth",
}
Key = tuple[tuple[str, int], ...]


def frames_of(setting: dict[str, int]) -> Callable[[], float]:
    """A function that renders the next frame of a history and returns its time [s]."""
    lines, spp = setting["pixels"], setting["spp"]
    own: dict[str, Any] = {k: v for k, v in setting.items() if k not in ("pixels", "spp")}
    if own["spatial_rounds"] == 0:
        own = {**own, "spatial_rounds": 1, "spatial": False}
    scene = scenes.load("ajar", lines * 16 // 9, lines)
    integrator = mi.load_dict({"type": "restir_pt", **own})

    def frame() -> float:
        start = time.perf_counter()
        dr.eval(mi.render(scene, integrator=integrator, spp=spp))
        dr.sync_thread()
        return time.perf_counter() - start

    return frame


def measured() -> dict[Key, float]:
    """Median time of a frame of each setting [s]."""
    settings = {
        tuple(sorted(setting.items())): setting
        for name, values in CHANGED.items()
        for setting in ({**USUAL, name: value} for value in values)
    }
    rendered = {key: frames_of(setting) for key, setting in settings.items()}
    for frame in rendered.values():
        for _ in range(WARM_UP):
            frame()
    times: dict[Key, list[float]] = {key: [] for key in rendered}
    for _ in range(FRAMES):
        for key, frame in rendered.items():
            times[key].append(frame())
    return {key: statistics.median(values) for key, values in times.items()}


def main() -> None:
    """Measure, write and draw."""
    mi.set_variant("llvm_ad_rgb")
    seconds = measured()
    usual = seconds[tuple(sorted(USUAL.items()))]
    rows = []
    figure = Figure(figsize=(9, 2.6), layout="constrained")
    for axes, (name, values) in zip(
        figure.subplots(1, 5, sharey=True), CHANGED.items(), strict=True
    ):
        ratios = [seconds[tuple(sorted({**USUAL, name: v}.items()))] / usual for v in values]
        rows += [
            (name, value, round(ratio, 3)) for value, ratio in zip(values, ratios, strict=True)
        ]
        axes.plot(values, ratios, "o-")
        axes.axhline(1, color="0.8", zorder=0)
        axes.set(xlabel=LABELS[name], xticks=values, yscale="log")
        axes.set_yticks([0.5, 1, 2, 4, 8], ["0.5", "1", "2", "4", "8"])
        axes.minorticks_off()
        axes.tick_params(labelsize=8)
    figure.axes[0].set_ylabel("time of a frame, relative")
    figure.savefig(HERE / "growth.png", dpi=150)
    with (HERE / "growth.csv").open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(
            [("what", "value", "time, relative"), *rows]
        )
    print(f"usual: {1000 * usual:.0f} ms;", ", ".join(f"{n} {v}: {r}" for n, v, r in rows))


if __name__ == "__main__":
    main()
