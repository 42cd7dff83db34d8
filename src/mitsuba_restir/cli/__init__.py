"""The command line: ``mitsuba-restir COMMAND``."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence

from .. import __version__
from ..errors import RestirError, one_line, root
from . import compare, doctor, evaluate, mask, render, scenes
from .arguments import OneLineParser

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it: 128 + SIGINT."""


def build_parser() -> OneLineParser:
    """Build the parser of all commands; each sets ``run``, a function of its arguments."""
    parser = OneLineParser(
        prog="mitsuba-restir",
        description="ReSTIR path tracing for Mitsuba 3.",
        epilog="Exit codes: 0 done, 1 failed while rendering, 2 wrong use, 130 interrupted.",
    )
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for module in (render, compare, evaluate, mask, scenes, doctor):
        module.add_command(commands)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Run one command.

    Parameters
    ----------
    arguments : sequence of str, optional
        The command line after the program's name, by default the process's own.

    Returns
    -------
    int
        Exit code: 0 done, 1 failed while rendering, 2 wrong use, 130 interrupted.
    """
    with warnings.catch_warnings():
        warnings.showwarning = _show_warning
        try:
            options = build_parser().parse_args(arguments)
            return int(options.run(options))
        except KeyboardInterrupt as error:
            return _interrupted(error)
        except RestirError as error:
            # Ctrl-C inside a plugin arrives as the cause of an error of Dr.Jit's.
            if isinstance(root(error), KeyboardInterrupt):
                return _interrupted(root(error))
            print(f"mitsuba-restir: {one_line(error)}", file=sys.stderr)
            return error.exit_code


def _interrupted(error: BaseException) -> int:
    # What a command has to say about it.
    text = f"; {error}" if str(error) else ""
    print(f"mitsuba-restir: interrupted{text}", file=sys.stderr)
    return INTERRUPTED


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    print(f"mitsuba-restir: warning: {one_line(message)}", file=sys.stderr)


__all__ = ["build_parser", "main"]
