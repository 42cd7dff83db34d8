"""Writing a study's report, with every figure and curve as a file of its own."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ...imageio import Image, encode_exr, encode_png
from ..config.files import dump_study
from ..config.study import REFERENCE, Reference, Study
from ..measure.frame_errors import chain_spectra
from ..measure.loading import load_size
from ..measure.quantities import NUMBERS
from ..measure.results import Measured, Refused, Row
from ..measure.table import Table
from ..runs.results import ReferenceImage
from ..store.arrays import make_folder
from ..store.folder import StudyFolder
from . import curves
from .drawings import Curves, draw
from .headline import headline, short
from .page import Content, Part, page
from .pictures import Gallery, Shown, galleries, shown_of
from .spectra import covariances_by_lag, mask_pictures, mutation_pictures, spectra
from .strips import strip

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
    parts = []
    lines: dict[str, list[curves.Record]] = {"curves": [], "spectra": [], "covariances": []}
    samples = {}
    for size in study.sizes:
        data = load_size(folder, size)
        if data.reference is not None:
            samples[data.size] = data.reference.samples
        powers = _powers(data)
        found = Curves(
            _convergence(data, notes),
            curves.radial_powers(data, powers),
            curves.lag_covariances(data),
        )
        lines["curves"] += curves.convergence_records(found.convergence, data.size)
        lines["spectra"] += curves.radial_records(found.radial, data.size)
        lines["covariances"] += curves.lag_records(found.lags, data.size)
        parts.append(_part(folder, data, table.rows, powers, found, notes))
        _write_frames(folder, data)
    for name, records in lines.items():
        if records:
            folder.write(f"{name}.csv", _csv(records))
    content = Content(
        study.name,
        study.about,
        command,
        _facts(study, samples),
        list(dict.fromkeys(notes)),
        parts,
        table.rows,
        dump_study(study).decode(),
        folder.environments(),
    )
    folder.write(NAME, page(content).encode())
    return folder.path / NAME


def _convergence(data: Measured, notes: list[str]) -> dict[str, curves.Curve]:
    """Return the errors by frame; a note instead where the reference is too noisy for them."""
    found = curves.convergence(data)
    if isinstance(found, Refused):
        notes.append(found.reason)
        return {}
    return found


def _powers(data: Measured) -> dict[str, curves.Values]:
    """Return the spectra of every run of every variant; empty without a reference."""
    return {} if data.reference is None else chain_spectra(data, data.reference)


def _part(
    folder: StudyFolder,
    data: Measured,
    rows: Sequence[Row],
    powers: Mapping[str, curves.Values],
    found: Curves,
    notes: list[str],
) -> Part:
    study = folder.study
    target = Path("figures") / data.size

    def write(name: str, content: bytes) -> None:
        make_folder(folder.path / target)
        folder.write(str(target / name), content)

    try:
        drawings = draw(data, rows, found, write)
    except ImportError as error:
        drawings = {}
        notes.append(f"There are no figures: {error}")
    shown = shown_of(data)
    pictures = _galleries(study, data, shown, powers, found)
    overview = None
    if shown.runs:
        by_key = {gallery.key: gallery.pictures for gallery in pictures}
        captions = _captions(rows, data.size)
        overview = strip(data, shown, by_key.get("spectra", {}), captions)
        write("strip.png", encode_png(overview))
    for gallery in pictures:
        for name, picture in gallery.pictures.items():
            file = f"{gallery.key}_{name}.png".replace(" ", "_").replace(",", "")
            write(file, encode_png(np.ascontiguousarray(picture)))
    top = headline(rows, data.size, study.published)
    return Part(
        data.size,
        top,
        data.baseline,
        data.baselines,
        _about_errors(data, {row.quantity for row in rows if row.size == data.size}),
        overview,
        {gallery.key: gallery for gallery in pictures},
        drawings,
    )


def _about_errors(data: Measured, quantities: set[str]) -> str:
    """Say how sure the reference is, where that is known, and what clipping does."""
    reference = data.reference
    sentences = []
    if reference is not None and reference.variance.any():
        relative = np.sqrt(reference.luminance_variance) / np.maximum(reference.luminance, 1e-30)
        median, worst = 100.0 * np.percentile(relative[reference.luminance > 0.0], [50.0, 90.0])
        sentences.append(
            "Squared errors and powers are without the reference's own error, which is "
            f"{median:.2g} % of a pixel's luminance in the median and {worst:.2g} % at the 90th "
            "percentile."
        )
        perfect = _with_its_noise(reference)
        said = set()
        for number in (n for n in NUMBERS.values() if n.name in quantities):
            if number.keeps_part:
                sentences.append(f"A part of it stays in “{number.name}”.")
            if number.keeps_all and number.keeps_all not in said:
                said.add(number.keeps_all)
                sentences.append(
                    f"All of it stays in “{number.name}”: of a perfect image it would be about "
                    f"{number.keeps_all(data, perfect, reference):.2g}."
                )
    if any("clipped" in name for name in quantities):
        sentences.append(
            "What is clipped favours images that are too dark: of errors that are very bright only "
            "a part counts. Look at the mean and at what is not clipped, too."
        )
    return " ".join(sentences)


def _with_its_noise(reference: ReferenceImage) -> Image:
    """Return what differs from a reference as the truth does: by noise of the same variance."""
    noise = np.random.default_rng(0).standard_normal((*reference.image.shape[:2], 1))
    image = reference.image + np.sqrt(reference.variance) * noise
    return np.maximum(image, 0.0).astype(np.float32)


def _galleries(
    study: Study,
    data: Measured,
    shown: Shown,
    powers: Mapping[str, curves.Values],
    found: Curves,
) -> list[Gallery]:
    pictures = [
        *galleries(data, shown),
        covariances_by_lag(found.lags),
        spectra(powers),
        mutation_pictures(study, data, shown),
        mask_pictures(study),
    ]
    return [gallery for gallery in pictures if gallery.pictures]


def _captions(rows: Sequence[Row], size: str) -> dict[str, str]:
    """Return a number for every variant, for where there is little room."""
    for number in (n for n in reversed(list(NUMBERS.values())) if n.caption):
        own = [row for row in rows if row.quantity == number.name and row.size == size]
        if own:
            return {
                row.variant: f"{number.caption} {short(row.value.value)} {row.unit}".rstrip()
                for row in own
            }
    return {}


def _facts(study: Study, samples: Mapping[str, int]) -> dict[str, str]:
    """Return what the reader should know, with the samples of the reference of every size."""
    apart = f", {study.stride} apart" if study.stride > 1 else ""
    facts = {
        "Scene": study.scene,
        "Longest path": "unlimited" if study.max_depth < 0 else f"{study.max_depth} edges",
        "Frames": f"{study.frames}{apart} after {study.warmup} of history",
        "Independent runs": str(study.runs),
        "Baseline": study.baseline,
    }
    if study.reference is not None:
        facts["Reference"] = _origin(study.reference, samples)
    return facts


def _origin(reference: Reference, samples: Mapping[str, int]) -> str:
    """Say what a reference is made of: fewer samples than asked for where its noise allowed it."""
    if reference.file:
        origin = reference.file
    elif len(set(samples.values())) == 1:
        origin = f"path, {next(iter(samples.values()))} samples per pixel"
    else:
        counts = ", ".join(f"{count} at {size}" for size, count in samples.items())
        origin = f"path, samples per pixel: {counts}"
    smooth = f", smoothed by a Gaussian of {reference.smooth:g} px" if reference.smooth else ""
    return origin + smooth


def _csv(records: Sequence[curves.Record]) -> bytes:
    text = io.StringIO()
    writer = csv.DictWriter(text, records[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(records)
    return text.getvalue().encode()


def _write_frames(folder: StudyFolder, data: Measured) -> None:
    """Write the frames that the report shows as they were rendered."""
    images = {name: runs[0].last for name, runs in data.runs.items() if runs}
    if data.reference is not None and images:
        images[REFERENCE] = data.reference.image.astype(np.float32)
    for name, image in images.items():
        make_folder(folder.path / "frames" / data.size)
        folder.write(str(Path("frames") / data.size / f"{name}.exr"), encode_exr(image))
