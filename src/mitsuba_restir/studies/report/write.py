"""Writing a study's report, with every figure and curve as a file of its own."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...imageio import encode_exr, encode_png
from ..config.files import dump_study
from ..config.study import REFERENCE
from ..measure.loading import load_size
from ..measure.results import Measured, Row
from ..measure.table import Table
from ..store.folder import StudyFolder
from .curves import Curves, Record, curves_of, records
from .drawings import draw
from .headline import headline
from .page import Part, page
from .pictures import galleries, shown_of
from .spectra import covariances_by_lag, mask_pictures, mutation_pictures, spectra
from .strips import strip
from .words import about_errors, captions, facts

NAME = "report.html"


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
        The page. Beside it are ``figures/`` (PNG and SVG), ``frames/`` (EXR) and the curves of the
        figures as CSV.

    Raises
    ------
    RenderError
        A file could not be written.
    """
    study = folder.study
    notes = list(table.notes)
    parts, samples = [], {}
    lines: dict[str, list[Record]] = {}
    for size in study.sizes:
        data = load_size(folder, size)
        if data.reference is not None:
            samples[data.size] = data.reference.samples
        found = curves_of(data, notes)
        for name, curves in found.files().items():
            lines.setdefault(name, []).extend(records(curves, data.size))
        parts.append(_part(folder, data, table.rows, found, notes))
        _write_frames(folder, data)
    for name, own in lines.items():
        if own:
            folder.write(f"{name}.csv", _csv(own))
    said = {
        "facts": facts(study, samples),
        "notes": list(dict.fromkeys(notes)),
        "command": command,
        "config": dump_study(study).decode(),
        "environments": folder.environments(),
    }
    folder.write(NAME, page(study, table.rows, parts, **said).encode())
    return folder.path / NAME


def _part(
    folder: StudyFolder, data: Measured, rows: Sequence[Row], found: Curves, notes: list[str]
) -> Part:
    study = folder.study

    def write(name: str, content: bytes) -> None:
        folder.write(f"figures/{data.size}/{name}", content)

    try:
        drawings = draw(data, rows, found, write)
    except ImportError as error:
        drawings = {}
        notes.append(f"There are no figures: {error}")
    shown = shown_of(data)
    pictures = {
        gallery.key: gallery
        for gallery in (
            *galleries(data, shown),
            covariances_by_lag(found.lags),
            spectra(found.powers),
            mutation_pictures(study, data, shown),
            mask_pictures(study),
        )
        if gallery.pictures
    }
    overview = None
    if shown.runs:
        of_errors = pictures["spectra"].pictures if "spectra" in pictures else {}
        overview = strip(data, shown, of_errors, captions(rows, data.size))
        write("strip.png", encode_png(overview))
    for gallery in pictures.values():
        for name, picture in gallery.pictures.items():
            file = f"{gallery.key}_{name}.png".replace(" ", "_").replace(",", "")
            write(file, encode_png(np.ascontiguousarray(picture)))
    return Part(
        data.size,
        headline(rows, data.size, study.published),
        data.baseline,
        data.baselines,
        about_errors(data, {row.quantity for row in rows if row.size == data.size}),
        overview,
        pictures,
        drawings,
    )


def _write_frames(folder: StudyFolder, data: Measured) -> None:
    """Write the frames that the report shows as they were rendered."""
    images = {name: runs[0].last for name, runs in data.runs.items() if runs}
    if data.reference is not None and images:
        images[REFERENCE] = data.reference.image.astype(np.float32)
    for name, image in images.items():
        folder.write(f"frames/{data.size}/{name}.exr", encode_exr(image))


def _csv(lines: Sequence[Record]) -> bytes:
    text = io.StringIO()
    writer = csv.DictWriter(text, lines[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)
    return text.getvalue().encode()
