"""Standard output that may go away: the work is done all the same, and ends without a traceback."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO, Any


class Stream:
    """
    A text stream that forgets what cannot be written.

    Fields
    ------
    failure : OSError or None
        Why writing stopped, once it has.
    """

    def __init__(self, stream: IO[str] | None) -> None:
        self._stream = stream or open(os.devnull, "w", encoding="utf-8")
        self.failure: OSError | None = None

    def write(self, text: str) -> int:
        """Write, as long as that works."""
        try:
            return self._stream.write(text)
        except OSError as error:
            self._give_up(error)
            return len(text)

    def flush(self) -> None:
        """Flush, as long as that works."""
        try:
            self._stream.flush()
        except OSError as error:
            self._give_up(error)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def _give_up(self, error: OSError) -> None:
        self.failure = self.failure or error
        # What is still in buffers would be tried again at exit, too late for anyone to catch.
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._stream.fileno())
        os.close(nowhere)

    @property
    def lost(self) -> str:
        """Why output was lost; nothing where its reader has closed it, having read enough."""
        if self.failure is None or isinstance(self.failure, BrokenPipeError):
            return ""
        return str(self.failure.strerror)


@contextmanager
def forgiving() -> Iterator[Stream]:
    """Have standard output and error forget what cannot be written; yields the first."""
    before = sys.stdout, sys.stderr
    output, error = Stream(before[0]), Stream(before[1])
    sys.stdout, sys.stderr = output, error  # type: ignore[assignment]
    try:
        yield output
    finally:
        output.flush()
        error.flush()
        sys.stdout, sys.stderr = before
