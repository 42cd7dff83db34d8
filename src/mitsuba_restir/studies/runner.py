"""Running a study: variants frame by frame in turn, every finished run saved at once."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from ..errors import rendering
from .config.study import Size, Study
from .measure.asked import check_quantities, probes_of, shows_images
from .measure.loading import load_size
from .measure.measuring import measure_size
from .measure.probes import PROBES
from .measure.results import Row
from .measure.table import Table
from .runs.reference import read_reference
from .runs.rendering import Renderer, make_renderer
from .runs.scene import load_scene
from .runs.turns import Cluster, rehearse, remote_run, render_run
from .store.folder import StudyFolder
from .store.reference import (
    load_reference,
    missing_batches,
    render_batches,
)

Progress = Callable[[int, int, str], None]


def run_study(
    study: Study, path: Path, progress: Progress | None = None, cluster: Cluster | None = None
) -> Table:
    """
    Render what is not finished yet, and measure.

    Parameters
    ----------
    study : Study
    path : Path
        Folder of the results; made where it does not exist, gone on with where it holds this study.
    progress : callable, optional
        Called with units done, units in all, and what is being rendered.
    cluster : callable, optional
        What runs are rendered by, instead of this process.

    Returns
    -------
    Table

    Raises
    ------
    UsageError
        The study cannot be run as it is; nothing has been rendered.
    RenderError
        A frame could not be rendered, or a result not written.
    """
    with StudyFolder(path, study) as folder:
        return run_folder(folder, progress, cluster)


def run_folder(
    folder: StudyFolder, progress: Progress | None = None, cluster: Cluster | None = None
) -> Table:
    """Do as `run_study`, in a folder that stays locked until it is released."""
    study = folder.study
    check_quantities(study)
    if study.reference is not None and study.reference.file:
        read_reference(study)
    with rendering(study.name):
        render_missing(folder, progress, cluster)
    folder.claim()
    return measure(folder)


def measure(folder: StudyFolder) -> Table:
    """Measure the finished runs of a study and write the table beside them."""
    study = folder.study
    sizes = [load_size(folder, size) for size in study.sizes]
    rows: list[Row] = []
    notes = [*folder.refused, *(note for data in sizes for note in data.notes)]
    for data in sizes:
        found, refused = measure_size(study, data)
        rows += found
        notes += refused
    table = Table(rows, tuple(dict.fromkeys(notes)), study.published)
    folder.write("results.csv", table.csv().encode())
    folder.write("results.json", table.json().encode())
    return table


def render_missing(
    folder: StudyFolder, progress: Progress | None = None, cluster: Cluster | None = None
) -> None:
    """Render the runs and batches that are not finished; safe to interrupt at any time."""
    study = folder.study
    todo = {size: _missing_runs(folder, size) for size in study.sizes}
    batches = {size: missing_batches(folder, size) for size in study.sizes}
    probes = _missing_probes(folder)
    # A sample of the reference counts as a frame, a probe as a run.
    samples = study.reference.batch_spp or 1 if study.reference else 0
    frames = study.length * (len(probes) + sum(len(n) for m in todo.values() for n in m.values()))
    meter = _Meter(progress, frames + samples * sum(batches.values()))
    if meter.total == 0:
        return
    scene = load_scene(study)
    renderers = {size: _renderers(study, scene, size, missing) for size, missing in todo.items()}
    folder.claim()
    for size, missing in todo.items():
        if missing and cluster is not None:
            _render_remotely(folder, cluster, size, missing, meter)
        elif missing:
            _render_size(folder, renderers[size], size, missing, meter)
        if batches[size]:
            done = partial(meter.advance, f"reference {size[0]}x{size[1]}", samples)
            render_batches(folder, scene, size, done)
    for size, name, probe, index in probes:
        label = f"{size[0]}x{size[1]} {probe} {name}"
        meter.advance(label, 0)
        reference = partial(load_reference, folder, size)
        found = PROBES[probe](study, size, name, index, reference)
        folder.save_probe(size, name, probe, index, found)
        meter.advance(label, study.length)


def _missing_probes(folder: StudyFolder) -> list[tuple[Size, str, str, int]]:
    study = folder.study
    return [
        (size, name, probe, index)
        for index in range(study.probe_runs)
        for size in study.sizes
        for probe in probes_of(study)
        for name in study.rendered()
        if folder.load_probe(size, name, probe, index) is None
    ]


def _missing_runs(folder: StudyFolder, size: Size) -> dict[int, list[str]]:
    study = folder.study
    if not shows_images(study):
        return {}
    missing = {
        index: [name for name in study.rendered() if folder.load_run(size, name, index) is None]
        for index in range(study.runs)
    }
    return {index: names for index, names in missing.items() if names}


def _renderers(
    study: Study, scene: Any, size: Size, missing: dict[int, list[str]]
) -> dict[str, Renderer]:
    wanted = {name for names in missing.values() for name in names}
    return {
        name: make_renderer(study, scene, size, name, variant)
        for name, variant in study.variants.items()
        if name in wanted
    }


def _render_size(
    folder: StudyFolder,
    renderers: dict[str, Renderer],
    size: Size,
    missing: dict[int, list[str]],
    meter: _Meter,
) -> None:
    study = folder.study
    label = f"{size[0]}x{size[1]}"
    meter.advance(f"{label}: compiling", 0)
    rehearse(study, renderers)
    for index, names in missing.items():
        run_label = f"{label} run {index + 1}/{study.runs}"

        def advance(name: str, _: object, run_label: str = run_label) -> None:
            meter.advance(f"{run_label} {name}")

        wanted = {name: renderers[name] for name in names}
        for name, run in render_run(study, wanted, index, advance).items():
            folder.save_run(size, name, index, run)


def _render_remotely(
    folder: StudyFolder, cluster: Cluster, size: Size, missing: dict[int, list[str]], meter: _Meter
) -> None:
    """Have a cluster render the runs of a size; each is saved as it comes back."""
    study = folder.study
    tasks = [(study, folder.scene, size, index, names) for index, names in missing.items()]
    for (*_, index, names), runs in cluster(remote_run, tasks):
        for name in names:
            folder.save_run(size, name, index, runs[name])
        label = f"{size[0]}x{size[1]} run {index + 1}/{study.runs}"
        meter.advance(label, len(names) * study.length)


class _Meter:
    """Counts finished units and passes them on."""

    def __init__(self, progress: Progress | None, total: int) -> None:
        self._progress = progress
        self.total = total
        self._done = 0

    def advance(self, text: str, units: int = 1) -> None:
        self._done += units
        if self._progress is not None:
            self._progress(self._done, self.total, text)
