"""The two ways in which a command can fail, and the exit code of each."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["RenderError", "RestirError", "UsageError"]


class RestirError(Exception):
    """An error that is reported to the user as one line, without a traceback."""

    exit_code = 1


class UsageError(RestirError):
    """Wrong use: the message says what was wrong and what is allowed. Nothing has been written."""

    exit_code = 2


class RenderError(RestirError):
    """Rendering or writing failed although the request itself was sound."""


def root(error: BaseException) -> BaseException:
    """Return the first cause of an error: Dr.Jit wraps what a plugin raises, naming only itself."""
    while error.__cause__ is not None:
        error = error.__cause__
    return error


def one_line(message: object) -> str:
    """
    Squeeze a message of Mitsuba's into one line that a user can read.

    Drops what only its developers need: C++ file names, the traceback of a Python plugin, and
    the name of the dictionary node.
    """
    text = str(message).strip()
    if "Traceback (most recent call last)" in text:
        text = re.sub(r"^\w+(?:Error|Exception): ", "", text.splitlines()[-1])
    line = " ".join(text.split())
    line = re.sub(r"\[\w+\.(?:cpp|h):\d+\] ", "", line)
    return re.sub(r'(?:At|While loading) dictionary node "root": ', "", line)


@contextmanager
def rendering(name: str = "") -> Iterator[None]:
    """
    Turn what Mitsuba and Dr.Jit raise within into an interrupt, or an error of one line.

    Parameters
    ----------
    name : str
        What is rendered, for the message.

    Raises
    ------
    RenderError
        Rendering failed.
    """
    try:
        yield
    except Exception as error:
        cause = root(error)
        if isinstance(cause, KeyboardInterrupt):
            raise KeyboardInterrupt from error
        if not isinstance(error, RuntimeError | SystemError | ValueError | MemoryError):
            raise
        prefix = f"{name}: " if name else ""
        raise RenderError(f"{prefix}rendering failed: {one_line(cause)}") from error
