"""The command line: ``mitsuba-restir COMMAND``.

What the commands need is imported once one is run, so that Ctrl-C is handled from then on.
"""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Sequence

from .. import __version__
from ..errors import RestirError, UsageError, one_line, root
from .arguments import OneLineParser
from .notes import say
from .signals import INTERRUPTED, TERMINATED, Termination, terminable
from .streams import Stream, forgiving

_COMMANDS = ("render", "still", "view", "compare", "evaluate", "mask", "scenes", "doctor")
_CODES = (
    f"0 done, 1 failed while rendering, 2 wrong use, {INTERRUPTED} interrupted, "
    f"{TERMINATED} terminated"
)


def build_parser() -> OneLineParser:
    """Build the parser of all commands; each sets ``run``, a function of its arguments."""
    parser = OneLineParser(
        prog="mitsuba-restir",
        description="ReSTIR path tracing for Mitsuba 3.",
        epilog=f"Exit codes: {_CODES}.",
    )
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name in _COMMANDS:
        importlib.import_module(f".{name}", __name__).add_command(commands)
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
        Exit code: 0 done, 1 failed while rendering, 2 wrong use, 130 interrupted (Ctrl-C), 143
        terminated (SIGTERM).
    """
    with forgiving() as output, terminable() as termination, warnings.catch_warnings():
        warnings.showwarning = _show_warning
        return _all_written(output, _run(arguments, termination))


def _run(arguments: Sequence[str] | None, termination: Termination) -> int:
    try:
        options = build_parser().parse_args(arguments)
        return int(options.run(options))
    except SystemExit as asked:  # by --help and --version
        return int(asked.code or 0)
    except (KeyboardInterrupt, Exception) as error:
        # Ctrl-C inside Mitsuba or Dr.Jit arrives as the cause of an error of theirs.
        if isinstance(root(error), KeyboardInterrupt):
            said = error if isinstance(error, KeyboardInterrupt) else ""
            return _interrupted(str(said), termination)
        return _failed(error)


def _failed(error: BaseException) -> int:
    if isinstance(error, RestirError):
        say(one_line(error))
        return error.exit_code
    if isinstance(error, OSError) and error.filename is not None:
        # A name that the system refuses, as for its length, before anyone could look at the file.
        say(f"{error.filename}: {error.strerror}")
        return UsageError.exit_code
    raise error


def _interrupted(remark: str, termination: Termination) -> int:
    how = "terminated" if termination.came else "interrupted"
    say(f"{how}; {remark}" if remark else how)
    return termination.code


def _all_written(output: Stream, code: int) -> int:
    """The exit code, given what became of the output."""
    output.flush()
    if output.lost and code == 0:
        say(f"cannot write standard output: {output.lost}")
        return 1
    return code


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    say(f"warning: {one_line(message)}")


__all__ = ["INTERRUPTED", "build_parser", "main"]
