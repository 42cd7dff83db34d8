"""Running a study: variants frame by frame in turn, every finished run saved at once."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from .config import Size, Study
from .measuring import measure_across, measure_size
from .probes import PROBES
from .reference import (
    REHEARSAL_KEY,
    RUN_KEY,
    load_reference,
    missing_batches,
    read_reference,
    render_batches,
)
from .rendering import Renderer, load_scene, make_renderer, seed_of
from .results import Image, Measured, Row, Run
from .store import StudyFolder
from .table import Table

Progress = Callable[[int, int, str], None]

# The first frame compiles kernels, the second those of a frame with history.
_REHEARSAL = 3


def run_study(study: Study, path: Path, progress: Progress | None = None) -> Table:
    """
    Render what is not finished yet, and measure.

    Parameters
    ----------
    study : Study
    path : Path
        Folder of the results; made where it does not exist, gone on with where it holds this study.
    progress : callable, optional
        Called with units done, units in all, and what is being rendered.

    Returns
    -------
    Table

    Raises
    ------
    UsageError
        The study cannot be run as it is; nothing has been rendered.
    RenderError
        A result could not be written.
    """
    if study.reference is not None and study.reference.file:
        read_reference(study)
    folder = StudyFolder(path, study)
    try:
        render_missing(folder, progress or _silent)
        folder.claim()
        return measure(folder)
    finally:
        folder.release()


def measure(folder: StudyFolder) -> Table:
    """Measure the finished runs of a study and write the table beside them."""
    study = folder.study
    sizes = [load_size(folder, size) for size in study.sizes]
    rows: list[Row] = []
    notes = list(folder.refused)
    for data in sizes:
        found, refused = measure_size(study, data)
        rows += found
        notes += refused
    table = Table(rows + measure_across(study, sizes), tuple(dict.fromkeys(notes)))
    folder.write("results.csv", table.csv().encode())
    folder.write("results.json", table.json().encode())
    return table


def load_size(folder: StudyFolder, size: Size) -> Measured:
    """Load the finished runs of a size, what the probes said, and the reference."""
    study = folder.study
    runs, probes = {}, {}
    for name in study.variants:
        loaded = [folder.load_run(size, name, index) for index in range(study.runs)]
        runs[name] = [run for run in loaded if run is not None]
        for probe in study.probes():
            answers = [folder.load_probe(size, name, probe, i) for i in range(study.probe_runs)]
            probes[name, probe] = [answer for answer in answers if answer is not None]
    reference = load_reference(folder, size)
    label = f"{size[0]}x{size[1]}"
    baselines = {name: study.baseline_of(name) for name in study.variants}
    return Measured(
        label, runs, study.baseline, baselines, reference, study.epsilon, study.trim, probes
    )


def render_missing(folder: StudyFolder, progress: Progress) -> None:
    """Render the runs and batches that are not finished; safe to interrupt at any time."""
    study = folder.study
    todo = {size: _missing_runs(folder, size) for size in study.sizes}
    batches = {size: missing_batches(folder, size) for size in study.sizes}
    probes = _missing_probes(folder)
    units = _frames_to_render(study, todo) + sum(map(len, batches.values())) + len(probes)
    meter = _Meter(progress, units)
    if meter.total == 0:
        return
    scene = load_scene(study)
    renderers = {size: _renderers(study, scene, size, missing) for size, missing in todo.items()}
    folder.claim()
    for size, missing in todo.items():
        if missing:
            _render_size(folder, renderers[size], size, missing, meter)
        if batches[size]:
            label = f"reference {size[0]}x{size[1]}"
            render_batches(folder, scene, size, batches[size], partial(meter.advance, label))
    for size, name, probe, index in probes:
        meter.say(f"{size[0]}x{size[1]} {probe} {name}")
        folder.save_probe(size, name, probe, index, PROBES[probe](study, size, name, index))
        meter.advance(f"{size[0]}x{size[1]} {probe} {name}")


def _missing_probes(folder: StudyFolder) -> list[tuple[Size, str, str, int]]:
    study = folder.study
    return [
        (size, name, probe, index)
        for index in range(study.probe_runs)
        for size in study.sizes
        for probe in study.probes()
        for name in study.variants
        if folder.load_probe(size, name, probe, index) is None
    ]


def _missing_runs(folder: StudyFolder, size: Size) -> dict[int, list[str]]:
    study = folder.study
    if not study.shows_images():
        return {}
    missing = {
        index: [name for name in study.variants if folder.load_run(size, name, index) is None]
        for index in range(study.runs)
    }
    return {index: names for index, names in missing.items() if names}


def _frames_to_render(study: Study, todo: dict[Size, dict[int, list[str]]]) -> int:
    runs = sum(len(names) for missing in todo.values() for names in missing.values())
    return runs * (study.warmup + study.frames)


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
    meter.say(f"{size[0]}x{size[1]}: compiling")
    for renderer in renderers.values():
        for frame in range(_REHEARSAL):
            seed = seed_of(study.seed, REHEARSAL_KEY, frame)
            renderer.frame_before_last(seed, _REHEARSAL - 1 - frame)
    for index, names in missing.items():
        runs = _render_runs(study, {name: renderers[name] for name in names}, index, meter, size)
        for name, run in runs.items():
            folder.save_run(size, name, index, run)


def _render_runs(
    study: Study, renderers: dict[str, Renderer], index: int, meter: _Meter, size: Size
) -> dict[str, Run]:
    """Render one run of several variants, taking turns at every frame."""
    for renderer in renderers.values():
        renderer.reset()
    images: dict[str, list[Image]] = {name: [] for name in renderers}
    sums: dict[str, Any] = dict.fromkeys(renderers, 0.0)
    times: dict[str, list[float]] = {name: [] for name in renderers}
    names = list(renderers)
    last = study.warmup + study.frames - 1
    for frame in range(last + 1):
        seed = seed_of(study.seed, RUN_KEY, index, frame)
        # Whoever comes first changes with every frame: no variant profits from its place.
        first = (index + frame) % len(names)
        for name in names[first:] + names[:first]:
            measured = frame >= study.warmup
            if measured or renderers[name].has_history:
                image, seconds = renderers[name].frame_before_last(seed, last - frame)
            if measured:
                times[name].append(seconds)
                sums[name] = sums[name] + image.astype(np.float64)
                images[name] = [*images[name], image] if study.keep == "all" else [image]
            meter.advance(f"{size[0]}x{size[1]} run {index + 1}/{study.runs} {name}")
    return {
        name: Run(
            images[name][-1],
            (sums[name] / study.frames).astype(np.float32),
            np.array(times[name]),
            partial(np.stack, images[name]) if study.keep == "all" else None,
        )
        for name in names
    }


class _Meter:
    """Counts finished units and passes them on."""

    def __init__(self, progress: Progress, total: int) -> None:
        self._progress = progress
        self.total = total
        self._done = 0

    def say(self, text: str) -> None:
        self._progress(self._done, self.total, text)

    def advance(self, text: str) -> None:
        self._done += 1
        self.say(text)


def _silent(done: int, total: int, text: str) -> None:
    """Show nothing."""
