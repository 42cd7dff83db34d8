"""A viewer in a process of its own, for tests that talk to it."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass


@dataclass(frozen=True)
class Running:
    """``process``, and the ``url`` that it has printed."""

    process: subprocess.Popen[str]
    url: str

    @property
    def place(self) -> str:
        """Host and port."""
        match = re.match(r"http://([^/]+)/", self.url)
        assert match is not None
        return match[1]


@contextmanager
def viewer(*arguments: str) -> Iterator[Running]:
    """A viewer with these arguments, ended at the end."""
    command = [sys.executable, "-m", "mitsuba_restir", "view", *arguments]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A shell in the background ignores Ctrl-C for its children.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        found = re.search(r"http://\S+", line)
        assert found, (line, process.stderr and process.stderr.read())
        yield Running(process, found[0])
    finally:
        process.kill()
        process.communicate()
