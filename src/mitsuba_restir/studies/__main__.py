"""Run a study: ``python -m mitsuba_restir.studies STUDY -o DIR``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from rich.console import Console

from ..errors import RestirError, UsageError, one_line
from .files import load_study, packaged_studies
from .progress import progress_bar
from .runner import run_study


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(message)


def _parser() -> _Parser:
    parser = _Parser(
        prog="python -m mitsuba_restir.studies",
        description="Run a study, or go on with one that was interrupted.",
    )
    parser.add_argument(
        "study", help=f"a TOML file, or one of the package: {', '.join(packaged_studies())}"
    )
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of the results")
    parser.add_argument(
        "-s",
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change a key of the study, as in runs=4 or variants.restir.spp=2",
    )
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; 0 done, 1 failed, 2 wrong use, 130 interrupted."""
    try:
        options = _parser().parse_args(arguments)
        study = load_study(options.study, options.set)
        with progress_bar(study.name) as report:
            table = run_study(study, options.output, report)
    except RestirError as error:
        print(f"mitsuba-restir: {one_line(error)}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print(
            "mitsuba-restir: interrupted; finished runs are kept, the same command goes on",
            file=sys.stderr,
        )
        return 130
    for note in table.notes:
        print(f"mitsuba-restir: {note}", file=sys.stderr)
    # Without a terminal there is no width to keep to; 80 columns would break every number.
    output = Console(width=None if sys.stdout.isatty() else 140)
    table.show(output, f"{study.name} ({options.output})")
    return 0


if __name__ == "__main__":
    sys.exit(main())
