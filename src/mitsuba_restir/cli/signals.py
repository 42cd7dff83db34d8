"""SIGTERM, as timeout and batch systems send it, ends a command as Ctrl-C does: nothing is lost."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

INTERRUPTED = 128 + signal.SIGINT
TERMINATED = 128 + signal.SIGTERM
"""Exit codes as shells have them."""

_ECHO = 1.0
"""Seconds in which a SIGTERM counts as the one before: timeout(1) sends it to the process and to
its group, and the second must not cut off what the first has begun."""


class Terminated(KeyboardInterrupt):
    """What SIGTERM raises. ``python -m`` ends by SIGINT, whatever the exit code, once a plain
    KeyboardInterrupt has passed through an ``exec`` of text, as the one of dataclasses."""


class Termination:
    """
    What SIGTERM does: it interrupts, once.

    Fields
    ------
    came : bool
        Whether it did.
    """

    def __init__(self) -> None:
        self.came = False
        self._last = -_ECHO

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Handle the signal."""
        now = time.monotonic()
        echo = now - self._last < _ECHO
        self._last = now
        if not echo:
            self.came = True
            raise Terminated

    @property
    def code(self) -> int:
        """Exit code of a command that was interrupted."""
        return TERMINATED if self.came else INTERRUPTED


@contextmanager
def terminable() -> Iterator[Termination]:
    """Have SIGTERM raise KeyboardInterrupt inside, where signals can be handled at all."""
    termination = Termination()
    if threading.current_thread() is not threading.main_thread():
        yield termination
        return
    before = signal.signal(signal.SIGTERM, termination)
    try:
        yield termination
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def held() -> Iterator[None]:
    """Finish what is inside before a SIGTERM or Ctrl-C counts; a second Ctrl-C does at once."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    waiting: list[int] = []
    handlers = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}

    def hold(number: int, frame: FrameType | None) -> None:
        if number == signal.SIGINT and number in waiting:
            raise KeyboardInterrupt
        waiting.append(number)

    for number in handlers:
        signal.signal(number, hold)
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        if waiting:
            signal.raise_signal(waiting[0])
