"""What equal time buys: path, a frame of a history and a still, as they are and denoised."""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
from PIL import Image as Pillow
from PIL import ImageDraw, ImageFont

from .. import imageio, still
from ..analysis import denoise, metrics
from ..imageio import Image
from ..studies.runs.rendering import denoiser_guides
from ..studies.runs.results import ReferenceImage

STRIP = "equal_time.png"
_MARGIN, _TITLE, _LABEL, _LEAST_WIDTH = 8, 30, 38, 230

SAMPLES = 8
"""Of `path` in one call: it is slower with few, and would end too late with many."""

_WARM_UP = 3
"""Frames until all kernels are compiled."""


@dataclass(frozen=True)
class Subject:
    """
    What is rendered, and for how long each time.

    Fields
    ------
    scene, sensor : Scene, Sensor
    depths : mapping
        Parameters that all integrators have.
    reuse : mapping
        Parameters of the history's frames.
    seconds : float
    seed : int
    """

    scene: mi.Scene
    sensor: mi.Sensor
    depths: Mapping[str, Any]
    reuse: Mapping[str, Any]
    seconds: float
    seed: int


@dataclass(frozen=True)
class Shown:
    """A picture, (H, W, 3), what it is called, and the time that it took [s]."""

    label: str
    seconds: float
    image: Image


def pictures(subject: Subject, report: Callable[[int, int, str], None]) -> list[Shown]:
    """
    Render for equal times; what is denoised comes last, where the denoiser is installed.

    Parameters
    ----------
    report : callable
        Progress: how many are done, of how many, and what it is.
    """
    report(0, 4, "equal time")
    path = _films(subject, {"type": "path", **subject.depths}, SAMPLES)
    report(1, 4, "equal time")
    history = _films(subject, {"type": "restir_pt", **subject.reuse}, 1)
    report(2, 4, "equal time")
    drawn = _still(subject, denoise=False)
    samples = f"path, {SAMPLES * path.frames} samples a pixel"
    frame = f"frame {history.frames} of a history"
    shown = [
        Shown(samples, path.seconds, path.mean),
        Shown(frame, history.seconds, history.last),
        Shown(f"still, {drawn.frames} frames", drawn.seconds, drawn.image),
    ]
    if not denoise.installed():
        return shown
    report(3, 4, "equal time")
    planned = _still(subject, denoise=True)
    assert planned.denoised is not None
    # They are the same for all, and in nobody's time.
    guides = denoiser_guides(subject.scene, subject.sensor)
    return [
        *shown,
        Shown(f"{samples}, denoised", path.seconds, denoise.denoise_guided(path.mean, *guides)),
        Shown(f"{frame}, denoised", history.seconds, denoise.denoise_guided(history.last, *guides)),
        Shown(f"still --denoise, {planned.frames} frames", planned.seconds, planned.denoised),
    ]


@dataclass(frozen=True)
class _Films:
    """The mean of films, (H, W, 3), the last one, how many they are, and their time [s]."""

    mean: Image
    last: Image
    frames: int
    seconds: float


def _films(subject: Subject, description: Mapping[str, Any], spp: int) -> _Films:
    """Frame after frame from a cold start, as long as the next one would end in time."""
    integrator = mi.load_dict(description)

    def render(seed: int) -> Image:
        film = mi.render(
            subject.scene, integrator=integrator, sensor=subject.sensor, spp=spp, seed=seed
        )
        return imageio.with_rgb(film, 0)

    for seed in range(_WARM_UP):
        render(subject.seed + seed)
    if reset := getattr(integrator, "reset", None):
        reset()
    total: Any = 0.0
    frames, elapsed, begin = 0, 0.0, time.perf_counter()
    while frames == 0 or elapsed * (frames + 1) <= subject.seconds * frames:
        last = render(subject.seed + _WARM_UP + frames)
        total, frames = total + last.astype(np.float64), frames + 1
        elapsed = time.perf_counter() - begin
    return _Films((total / frames).astype(np.float32), last, frames, elapsed)


def _still(subject: Subject, denoise: bool) -> still.Still:
    def render(seconds: float) -> still.Still:
        return still.render(
            subject.scene,
            subject.sensor,
            seconds=seconds,
            denoise=denoise,
            seed=subject.seed,
            **subject.depths,
        )

    render(0.1)  # compiles the kernels
    return render(subject.seconds)


def strip(title: str, shown: Sequence[Shown], reference: ReferenceImage) -> Image:
    """
    Draw the pictures in rows of three, with what they took and how far off they are.

    Returns
    -------
    array, (H, W, 3), uint8
    """
    height, width = reference.image.shape[:2]
    across = max(width, _LEAST_WIDTH) + _MARGIN
    down = height + _LABEL + _MARGIN
    rows = [shown[i : i + 3] for i in range(0, len(shown), 3)]
    canvas = Pillow.new("RGB", (3 * across + _MARGIN, _TITLE + len(rows) * down), "white")
    draw = ImageDraw.Draw(canvas)
    draw.text((_MARGIN, _MARGIN), title, fill="black", font=ImageFont.load_default(16))
    font = ImageFont.load_default(12)
    for line, row in enumerate(rows):
        for column, picture in enumerate(row):
            x, y = _MARGIN + column * across, _TITLE + line * down
            text = (
                f"{picture.label}\n{picture.seconds:.1f} s, relMSE {error(picture, reference):.2g}"
            )
            draw.text((x, y), text, fill="black", font=font, spacing=2)
            canvas.paste(Pillow.fromarray(imageio.to_srgb8(picture.image)), (x, y + _LABEL - 4))
    return np.array(canvas)


def error(picture: Shown, reference: ReferenceImage) -> float:
    """relMSE without the largest 0.1 % of the pixels' errors."""
    return metrics.trimmed_relmse(
        picture.image, reference.image, reference_variance=reference.variance
    )


def write(folder: Path, title: str, shown: Sequence[Shown], reference: ReferenceImage) -> None:
    """Write the pictures in rows, and their numbers as CSV."""
    lines = [("picture", "seconds", "relmse_trimmed")]
    lines += [(s.label, f"{s.seconds:.3f}", f"{error(s, reference):.4g}") for s in shown]
    text = io.StringIO()
    csv.writer(text).writerows(lines)
    imageio.write_atomically(folder / "equal_time.csv", text.getvalue().encode())
    picture = strip(f"{title}: equal time", shown, reference)
    imageio.write_atomically(folder / STRIP, imageio.encode_png(picture))
