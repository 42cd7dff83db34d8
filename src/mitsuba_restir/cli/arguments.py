"""A parser that ends wrong use with one line, and the types of the arguments."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from typing import Any, NoReturn

from ..errors import UsageError

MAX_SIDE = 16384
MAX_PIXELS = 2**26


class OneLineParser(argparse.ArgumentParser):
    """An ``argparse`` parser whose errors are raised as one-line `UsageError`."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        # An abbreviation that works today breaks when an option is added.
        super().__init__(*args, **{"allow_abbrev": False, **kwargs})

    def error(self, message: str) -> NoReturn:
        """Raise instead of printing the usage text."""
        raise UsageError(f"{message} (see {self.prog} --help)")


def integer(minimum: int, maximum: int = 2**31 - 1) -> Callable[[str], int]:
    """Return the argument type of integers in [minimum, maximum]."""

    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = None
        if value is None or not minimum <= value <= maximum:
            raise argparse.ArgumentTypeError(
                f"'{text}' is not an integer from {minimum} to {maximum}"
            )
        return value

    return parse


def positive(text: str, noun: str = "number") -> float:
    """Parse a finite number above zero."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"'{text}' is not a {noun} above 0")
    return value


def positive_seconds(text: str) -> float:
    """Parse a finite time above zero, in seconds."""
    return positive(text, "number of seconds")


def seconds_between(text: str) -> float | None:
    """Parse a time between two events, in seconds; 0 is never."""
    return None if text.strip() == "0" else positive_seconds(text)


def place(text: str, port: int) -> tuple[str, int]:
    """Parse ``HOST:PORT``; where the port is left out, it is ``port``."""
    host, colon, number = text.rpartition(":") if ":" in text else (text, "", "")
    if not host or (colon and not (number.isdecimal() and 0 < int(number[:6]) < 2**16)):
        raise argparse.ArgumentTypeError(f"'{text}' is not of the form HOST:PORT")
    return host, int(number) if colon else port


def resolution(text: str) -> tuple[int, int]:
    """Parse ``WIDTHxHEIGHT`` in pixels."""
    width, _, height = text.lower().partition("x")
    allowed = f"WIDTHxHEIGHT, each from 1 to {MAX_SIDE} and together at most {MAX_PIXELS} pixels"
    if not (width.isascii() and width.isdigit() and height.isascii() and height.isdigit()):
        raise argparse.ArgumentTypeError(f"'{text}' is not a size: give {allowed}")
    size = int(width[:9]), int(height[:9])
    if not all(1 <= side <= MAX_SIDE for side in size) or size[0] * size[1] > MAX_PIXELS:
        raise argparse.ArgumentTypeError(f"'{text}' is not an allowed size: give {allowed}")
    return size


def assignment(text: str) -> tuple[str, str]:
    """Parse ``name=value``."""
    name, equals, value = text.partition("=")
    if not equals or not name.strip():
        raise argparse.ArgumentTypeError(f"'{text}' is not of the form name=value")
    return name.strip(), value


def as_dict(assignments: list[tuple[str, str]], option: str) -> dict[str, str]:
    """
    Collect repeated assignments.

    Raises
    ------
    UsageError
        A name occurs twice.
    """
    values: dict[str, str] = {}
    for name, value in assignments:
        if name in values:
            raise UsageError(f"argument {option}: '{name}' is given twice")
        values[name] = value
    return values
