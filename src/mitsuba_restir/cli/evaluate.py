"""``mitsuba-restir evaluate``: a whole study, and its report."""

from __future__ import annotations

import argparse
import shlex
import sys
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console

from ..errors import UsageError
from ..studies import load_study, packaged_studies, write_report
from ..studies.config.adapt import adapt, without
from ..studies.config.study import Reference, Study
from ..studies.runner import run_folder
from ..studies.runs.dask_cluster import dask_cluster
from ..studies.store.folder import StudyFolder
from .progress import progress_bar


def add_command(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "evaluate",
        help="run a study and write its report",
        description="Run a study, or go on with one that was interrupted, and write its report. "
        f"Studies of the package: {', '.join(packaged_studies())}.",
    )
    parser.add_argument("study", metavar="STUDY", help="name of a study, or a TOML file")
    parser.add_argument("-o", dest="output", metavar="FOLDER", help="folder for the results")
    parser.add_argument(
        "--scene", help="another scene: an XML file, or the name of an embedded one"
    )
    parser.add_argument(
        "--quick", action="store_true", help="small images and few runs: a look, not a measurement"
    )
    parser.add_argument(
        "--reference",
        metavar="EXR",
        help="compare with this image instead of rendering a reference; of the study's size",
    )
    parser.add_argument(
        "--reference-variance", metavar="EXR", help="variance of each of its values, as an image"
    )
    parser.add_argument(
        "--without", action="append", default=[], metavar="VARIANT", help="leave a variant out"
    )
    parser.add_argument(
        "-s",
        dest="changes",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change a key of the study, as in runs=4 or variants.path.spp=2",
    )
    parser.add_argument(
        "--dask", metavar="ADDRESS", help="render the runs on the workers of a Dask scheduler"
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the study; 0 when the report is written."""
    study = _study(options)
    path = Path(options.output or _folder(options, study))
    try:
        # Two processes at once would mix their figures: the folder stays locked for the report.
        with StudyFolder(path, study) as folder:
            _evaluate(folder, options.dask, _command(options, path))
    except KeyboardInterrupt as error:
        raise KeyboardInterrupt("finished runs are kept, the same command goes on") from error
    return 0


def _evaluate(folder: StudyFolder, dask: str | None, command: str) -> None:
    name = folder.study.name
    runs_on = dask_cluster(dask) if dask else nullcontext()
    with runs_on as cluster, progress_bar(name) as report:
        table = run_folder(folder, report, cluster)
    for note in table.notes:
        print(f"mitsuba-restir: {note}", file=sys.stderr)
    # Without a terminal there is no width to keep to; 80 columns would break every number.
    console = Console(width=None if sys.stdout.isatty() else 140)
    table.show(console, f"{name} ({folder.path})")
    print(f"Report: {write_report(folder, table, command)}")


def _study(options: argparse.Namespace) -> Study:
    whole = partial(adapt, scene=options.scene, small=options.quick)
    study = load_study(options.study, options.changes, whole)
    return _with_reference(options, without(study, options.without))


def _with_reference(options: argparse.Namespace, study: Study) -> Study:
    file, variance = options.reference, options.reference_variance
    if variance and not file:
        raise UsageError("argument --reference-variance: it needs --reference")
    if not file:
        return study
    if options.quick:
        raise UsageError("argument --reference: --quick changes the size; leave one of them out")
    return replace(study, reference=Reference(file=file, variance=variance or ""))


def _folder(options: argparse.Namespace, study: Study) -> str:
    parts = [study.name]
    if options.scene:
        path = Path(options.scene)
        parts.append(path.parent.name if path.stem == "scene" else path.stem)
    if options.quick:
        parts.append("quick")
    return "out/evaluate-" + "-".join(part for part in parts if part)


def _command(options: argparse.Namespace, folder: Path) -> str:
    words = ["mitsuba-restir", "evaluate", options.study, "-o", str(folder)]
    if options.scene:
        words += ["--scene", options.scene]
    if options.quick:
        words.append("--quick")
    for option in ("reference", "reference_variance"):
        if value := getattr(options, option):
            words += [f"--{option.replace('_', '-')}", value]
    for option, values in (("--without", options.without), ("-s", options.changes)):
        for value in values:
            words += [option, value]
    return shlex.join(words)
