"""What every benchmark's command does: measure all variants of a study, and show a table."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console

from mitsuba_restir.errors import RenderError, UsageError
from mitsuba_restir.imageio import write_atomically
from mitsuba_restir.studies import Study, Table, load_study
from mitsuba_restir.studies.config.adapt import adapt
from mitsuba_restir.studies.config.study import Size
from mitsuba_restir.studies.measure.results import Row
from mitsuba_restir.studies.measure.rows import interval_of

from .child import ask
from .task import Task

Answers = Mapping[Size, Sequence[Mapping[str, float]]]
"""What was measured of every run of a variant, by size."""


def main(
    benchmark: str,
    unit_of: Callable[[str], str] = lambda name: "",
    measure: Callable[[Task], Mapping[str, float]] | None = None,
    across: Callable[[Answers], Mapping[str, Sequence[float]]] = lambda answers: {},
) -> int:
    """
    Run the command of a benchmark; 0 where all was measured.

    Parameters
    ----------
    benchmark : str
        Name of its module.
    unit_of : callable
        Unit of a number by its name.
    measure : callable, optional
        Measures a task; a process of its own by default.
    across : callable
        What follows from all sizes of a variant together, in bytes per pixel, of every run.
    """
    options = _parser(benchmark).parse_args()
    try:
        study = _study(options)
        rows = list(_rows(study, unit_of, measure or partial(ask, benchmark), across))
        table = Table(rows)
        if options.output:
            write_atomically(Path(options.output), table.csv().encode())
    except (UsageError, RenderError) as error:
        print(f"benchmarks.{benchmark}: {error}", file=sys.stderr)
        return 2 if isinstance(error, UsageError) else 1
    table.show(Console(width=None if sys.stdout.isatty() else 140), f"{benchmark}, {study.name}")
    return 0


def _parser(benchmark: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog=f"python -m benchmarks.{benchmark}")
    parser.add_argument("study", metavar="STUDY", help="name of a study, or a TOML file")
    parser.add_argument("--scene", help="another scene: an XML file, or an embedded one's name")
    parser.add_argument("--quick", action="store_true", help="small images, one run")
    parser.add_argument("-o", dest="output", metavar="CSV", help="file for the numbers")
    parser.add_argument(
        "-s", dest="changes", action="append", default=[], metavar="KEY=VALUE",
        help="change a key of the study, as in probe_runs=4",
    )  # fmt: skip
    return parser


def _study(options: argparse.Namespace) -> Study:
    own = Path(__file__).parent / f"{options.study}.toml"
    whole = partial(adapt, scene=options.scene, small=options.quick)
    return load_study(str(own) if own.is_file() else options.study, options.changes, whole)


def _rows(
    study: Study,
    unit_of: Callable[[str], str],
    measure: Callable[[Task], Mapping[str, float]],
    across: Callable[[Answers], Mapping[str, Sequence[float]]],
) -> Iterator[Row]:
    found: dict[str, dict[Size, list[Mapping[str, float]]]] = {}
    for size in study.sizes:
        for name in study.rendered():
            tasks = [Task(study, size, name, index) for index in range(study.probe_runs)]
            print(f"{size[0]}x{size[1]} {name}", file=sys.stderr)
            answers = [measure(task) for task in tasks]
            found.setdefault(name, {})[size] = answers
            for number in dict.fromkeys(n for answer in answers for n in answer):
                values = [answer[number] for answer in answers if number in answer]
                label = f"{size[0]}x{size[1]}"
                yield _row(label, name, number, unit_of(number), values)
    for name, by_size in found.items():
        for number, slopes in across(by_size).items():
            yield _row("all", name, number, "B/pixel", slopes)


def _row(size: str, variant: str, number: str, unit: str, values: Sequence[float]) -> Row:
    return Row(size, variant, number, unit, interval_of(np.array(values)), None, len(values))
