"""What a command says beside its results: lines of standard error with the program's name."""

from __future__ import annotations

import sys


def say(text: str) -> None:
    """Say one line."""
    print(f"mitsuba-restir: {text}", file=sys.stderr)
