"""What ``compare`` shows: a table, a labelled strip of pictures, CSV and JSON."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image as Pillow
from PIL import ImageDraw, ImageFont
from rich import box
from rich.table import Table

from .. import imageio
from ..imageio import Image

STRIP = "compare.png"
_MARGIN = 6
_LABEL_HEIGHT = 34
_LABEL_WIDTH = 170


class Errors(NamedTuple):
    """relMSE of an image, and relMSE without the largest 0.1 % of the pixels' errors."""

    relmse: float
    trimmed: float


@dataclass(frozen=True)
class Row:
    """
    One variant's result.

    Fields
    ------
    label : str
    milliseconds : float
        Median time of a frame.
    frame_errors, mean_errors : Errors
        Of a single frame at the end of the run, and of the mean of all frames.
    frames : int
    last, mean : arrays, (H, W, 3)
        The last frame, and the mean of all.
    """

    label: str
    milliseconds: float
    frame_errors: Errors
    mean_errors: Errors
    frames: int
    last: Image
    mean: Image

    def gains(self, path: Row, trimmed: bool) -> tuple[float, float, float]:
        """
        Return how much longer `path` needs for the same error, three ways.

        Error times time of one `path` frame over that of: the last frame at its own time; the
        last frame charged with all frames before it; the mean of all frames. NaN where nothing is
        left of an error but the reference's.
        """

        def error(errors: Errors) -> float:
            found = errors.trimmed if trimmed else errors.relmse
            return found if found > 0.0 else float("nan")

        effort = error(path.frame_errors) * path.milliseconds
        own = effort / (error(self.frame_errors) * self.milliseconds)
        mean = effort / (error(self.mean_errors) * self.milliseconds * self.frames)
        return own, own / self.frames, mean

    def numbers(self, path: Row) -> dict[str, str | float | None]:
        """Return all numbers by name; None where there is none."""
        result: dict[str, str | float | None] = {
            "variant": self.label,
            "frames": self.frames,
            "milliseconds_per_frame": self.milliseconds,
        }
        for kind, suffix in (("relmse", ""), ("trimmed", "_trimmed")):
            own, charged, mean = self.gains(path, kind == "trimmed")
            numbers = {
                "relmse_frame": getattr(self.frame_errors, kind),
                "relmse_mean_of_frames": getattr(self.mean_errors, kind),
                "gain_last_frame": own,
                "gain_last_frame_charged_with_all": charged,
                "gain_mean_of_frames": mean,
            }
            result |= {
                f"{name}{suffix}": None if math.isnan(number) else number
                for name, number in numbers.items()
            }
        return result


def table(title: str, reference: str, rows: Sequence[Row]) -> Table:
    """Build the table for the terminal; the first row is `path`, the yardstick."""
    frames = rows[0].frames
    result = Table(
        title=title,
        box=box.SIMPLE_HEAD,
        caption=f"relMSE against the reference ({reference}), in brackets without the largest 0.1 "
        "% of errors. Gain: how many times longer path tracing takes for the same error as frame "
        f"{frames} at its own time; as frame {frames} charged with all {frames}; as their mean. "
        "One run, and so without intervals: see evaluate.",
    )
    result.add_column("variant", no_wrap=True)
    headings = ("ms", f"relMSE of frame {frames}", "relMSE of mean")
    for heading in (*headings, "gain, frame", "gain, charged", "gain, mean"):
        result.add_column(heading, justify="right")
    for row in rows:
        errors = [
            f"{entry.relmse:.3g} ({entry.trimmed:.3g})"
            for entry in (row.frame_errors, row.mean_errors)
        ]
        pairs = zip(row.gains(rows[0], False), row.gains(rows[0], True), strict=True)
        gains = [f"{plain:.2g} ({trimmed:.2g})" for plain, trimmed in pairs]
        result.add_row(row.label, f"{row.milliseconds:.0f}", *errors, *gains)
    return result


def strip(title: str, rows: Sequence[Row], reference: Image) -> np.ndarray:
    """
    Draw a labelled strip: single frames above, means of all frames below, reference at the end.

    Returns
    -------
    array, (H, W, 3), uint8
    """
    height, width = reference.shape[:2]
    cell_width = max(width, _LABEL_WIDTH) + _MARGIN
    cell_height = height + _LABEL_HEIGHT + _MARGIN
    size = (cell_width * (len(rows) + 1) + _MARGIN, cell_height * 2 + _LABEL_HEIGHT)
    canvas = Pillow.new("RGB", size, "white")
    draw = ImageDraw.Draw(canvas)
    title_font, font = ImageFont.load_default(16), ImageFont.load_default(12)
    draw.text((_MARGIN, _MARGIN), title, fill="black", font=title_font)
    columns = [_cells(row) for row in rows] + [[(reference, "reference", "")] * 2]
    for column, cells in enumerate(columns):
        for line, (image, label, numbers) in enumerate(cells):
            x = _MARGIN + column * cell_width
            y = _LABEL_HEIGHT + line * cell_height
            draw.text((x, y), f"{label}\n{numbers}", fill="black", font=font, spacing=2)
            canvas.paste(Pillow.fromarray(imageio.to_srgb8(image)), (x, y + _LABEL_HEIGHT))
    return np.array(canvas)


def _cells(row: Row) -> list[tuple[Image, str, str]]:
    """Return picture, label and numbers of a row's last frame, and of the mean of all."""
    seconds = row.milliseconds * row.frames / 1000.0
    last, mean = (f"relMSE {errors.relmse:.3g}" for errors in (row.frame_errors, row.mean_errors))
    return [
        (row.last, f"{row.label}, frame {row.frames}", f"{last}, {row.milliseconds:.0f} ms"),
        (row.mean, f"{row.label}, mean of {row.frames}", f"{mean}, {seconds:.1f} s"),
    ]


def write(folder: Path, title: str, rows: Sequence[Row], reference: Image) -> None:
    """Write the strip, the numbers as CSV and JSON, and every picture as EXR."""
    numbers = [row.numbers(rows[0]) for row in rows]
    text = io.StringIO()
    writer = csv.DictWriter(text, numbers[0])
    writer.writeheader()
    writer.writerows(numbers)
    pictures = {"reference": reference}
    for row in rows:
        name = row.label.replace(" ", "_")
        pictures |= {f"{name}_last": row.last, f"{name}_mean": row.mean}
    files = {f"{name}.exr": imageio.encode_exr(image) for name, image in pictures.items()}
    files["compare.csv"] = text.getvalue().encode()
    files["compare.json"] = json.dumps({"title": title, "variants": numbers}, indent=2).encode()
    files[STRIP] = imageio.encode_png(strip(title, rows, reference))
    for name, data in files.items():
        imageio.write_atomically(folder / name, data)
