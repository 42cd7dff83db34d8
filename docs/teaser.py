"""The picture at the top of README.md: path tracing and a still at equal time.

    python docs/teaser.py    # writes docs/figures/teaser.jpg

The embedded room, with crops four times as large.
"""

# mitsuba_restir brings the LLVM, and comes before mitsuba.
# ruff: noqa: I001

from __future__ import annotations

from pathlib import Path

from mitsuba_restir import scenes
import mitsuba as mi
from PIL import Image, ImageDraw, ImageFont

from mitsuba_restir.cli.compare_time import Shown, Subject, pictures
from mitsuba_restir.imageio import to_srgb8

WIDTH, HEIGHT = 480, 270
SECONDS = 10.0
EXPOSURE = 1.6
ZOOM = 4
CROPS = ((176, 100), (60, 112))
"""Left upper corners [pixels]."""

GAP, LABEL = 8, 30
DEPTHS = {"max_depth": 10}


def column(shown: Shown, title: str) -> Image.Image:
    """A picture under its title, above its crops."""
    picture = Image.fromarray(to_srgb8(EXPOSURE * shown.image))
    side = (WIDTH - GAP) // 2
    canvas = Image.new("RGB", (WIDTH, LABEL + HEIGHT + GAP + side * 9 // 16), "white")
    pen = ImageDraw.Draw(canvas)
    pen.text((0, 3), title, fill="black", font=ImageFont.load_default(18))
    canvas.paste(picture, (0, LABEL))
    for index, (x, y) in enumerate(CROPS):
        box = (x, y, x + side // ZOOM, y + side * 9 // 16 // ZOOM)
        crop = picture.crop(box).resize((side, side * 9 // 16), Image.Resampling.NEAREST)
        canvas.paste(crop, (index * (side + GAP), LABEL + HEIGHT + GAP))
    return canvas


def teaser() -> Image.Image:
    """Both columns beside each other."""
    mi.set_variant("llvm_ad_rgb")
    scene = scenes.load("ajar", WIDTH, HEIGHT)
    subject = Subject(scene, scene.sensors()[0], DEPTHS, DEPTHS, SECONDS, 0)
    path, _, still, *_ = pictures(subject, lambda done, count, what: None)
    columns = [
        column(path, f"path tracing, {path.seconds:.0f} s"),
        column(still, f"a still of mitsuba-restir, {still.seconds:.0f} s"),
    ]
    height = columns[0].height
    canvas = Image.new("RGB", (2 * WIDTH + 3 * GAP, height + 2 * GAP), "white")
    for index, drawn in enumerate(columns):
        canvas.paste(drawn, (GAP + index * (WIDTH + GAP), GAP))
    return canvas


if __name__ == "__main__":
    place = Path(__file__).parent / "figures" / "teaser.jpg"
    teaser().save(place, quality=88, subsampling=0, optimize=True)
    print(f"{place}: {place.stat().st_size / 1000:.0f} kB")
