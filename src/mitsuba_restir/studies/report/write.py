"""Writing a study's report, with every figure and curve as a file of its own."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...imageio import encode_exr, encode_png
from ..arrays import make_folder
from ..config import Study
from ..files import dump_study
from ..results import Measured, Row
from ..runner import load_size
from ..store import StudyFolder
from ..table import Table
from . import figures
from .curves import Curve, curves, records
from .headline import headline
from .page import Content, Part, page
from .pictures import Gallery, error_spectra, galleries

NAME = "report.html"

# Quantities drawn as bars where a study has them.
_BARS = (
    "time of a frame",
    "relMSE, trimmed",
    "relative covariance r=8",
    "relative covariance r=8, clipped",
    "HDR-FLIP after OIDN",
)


def write_report(folder: StudyFolder, table: Table, command: str) -> Path:
    """
    Write the report of a finished study into its folder.

    Parameters
    ----------
    folder : StudyFolder
    table : Table
        The measured study.
    command : str
        The command that makes it again.

    Returns
    -------
    Path
        The page. Beside it are ``figures/`` (PNG and SVG), ``frames/`` (EXR) and, where every
        frame was kept, ``curves.csv``.

    Raises
    ------
    RenderError
        A file could not be written.
    """
    parts: list[Part] = []
    notes = list(table.notes)
    lines: list[dict[str, str | float | int]] = []
    for size in folder.study.sizes:
        data = load_size(folder, size)
        found = curves(data)
        lines += records(found, data.size)
        shown = galleries(data)
        try:
            drawings = _drawings(folder, data, table.rows, found)
        except ImportError as error:
            drawings = {}
            notes.append(f"There are no figures: {error}")
        _write_pictures(folder, data.size, shown)
        _write_frames(folder, data)
        top = headline(table.rows, data.size, folder.study.published)
        parts.append(Part(data.size, top, data.baseline, shown, drawings))
    if lines:
        text = io.StringIO()
        writer = csv.DictWriter(text, lines[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(lines)
        folder.write("curves.csv", text.getvalue().encode())
    study = folder.study
    content = Content(
        study.name,
        study.about,
        command,
        _facts(study),
        list(dict.fromkeys(notes)),
        parts,
        table.rows,
        dump_study(study).decode(),
        folder.environments(),
    )
    folder.write(NAME, page(content).encode())
    return folder.path / NAME


def _facts(study: Study) -> dict[str, str]:
    facts = {
        "Scene": study.scene,
        "Longest path": "unlimited" if study.max_depth < 0 else f"{study.max_depth} edges",
        "Frames": f"{study.frames} after {study.warmup} of history",
        "Independent runs": str(study.runs),
        "Baseline": study.baseline,
    }
    if study.reference is not None:
        spp = study.reference.spp
        facts["Reference"] = f"path, {spp} samples per pixel" if spp else study.reference.file
    return facts


def _drawings(
    folder: StudyFolder, data: Measured, rows: Sequence[Row], found: dict[str, Curve]
) -> dict[str, str]:
    """Draw, write as PNG and SVG, and return as SVG by caption."""
    drawn = {}
    for quantity in _BARS:
        own = [r for r in rows if r.size == data.size and r.quantity == quantity]
        if own:
            key = "".join(c if c.isalnum() else "_" for c in quantity)
            drawn[key] = (f"{quantity}, with 95 % intervals", figures.bars(own, quantity))
    shown = {name: runs for name, runs in data.runs.items() if runs}
    if shown and data.reference is not None:
        caption = "Power of the relative error by frequency: reuse leaves its blotches on the left"
        drawn["radial_spectrum"] = (caption, figures.radial(error_spectra(data, shown)))
    if found:
        for over in ("frames", "seconds"):
            caption = f"Error over {over}: thin, single frames; thick, the average of all so far"
            drawn[f"convergence_{over}"] = (caption, figures.convergence(found, over))
    target = folder.path / "figures" / data.size
    result = {}
    for key, (caption, figure) in drawn.items():
        make_folder(target)
        svg = figures.encode(figure, "svg")
        folder.write(str(Path("figures") / data.size / f"{key}.svg"), svg)
        png = figures.encode(figure, "png")
        folder.write(str(Path("figures") / data.size / f"{key}.png"), png)
        text = svg.decode()
        # Ids of several drawings in one page must not meet.
        unique = text[text.index("<svg") :].replace('id="', f'id="{data.size}_{key}_')
        for link in ('xlink:href="#', "url(#"):
            unique = unique.replace(link, f"{link}{data.size}_{key}_")
        result[caption] = unique
    return result


def _write_frames(folder: StudyFolder, data: Measured) -> None:
    """Write the frames that the report shows as they were rendered."""
    images = {name: runs[0].last for name, runs in data.runs.items() if runs}
    if data.reference is not None and images:
        images["reference"] = data.reference.image.astype(np.float32)
    for name, image in images.items():
        make_folder(folder.path / "frames" / data.size)
        folder.write(str(Path("frames") / data.size / f"{name}.exr"), encode_exr(image))


def _write_pictures(folder: StudyFolder, size: str, shown: list[Gallery]) -> None:
    for gallery in shown:
        for name, picture in gallery.pictures.items():
            make_folder(folder.path / "figures" / size)
            file = Path("figures") / size / f"{gallery.key}_{name}.png"
            folder.write(str(file), encode_png(np.ascontiguousarray(picture)))
