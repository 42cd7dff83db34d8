"""Reading a TOML table key by key, with one clear line for what is wrong."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from ...errors import UsageError

_MISSING: Any = object()


def _is_number(value: object) -> bool:
    """Say whether a value is a finite number; TOML's integers may exceed every float."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return False
    return abs(value) <= sys.float_info.max


class Reader:
    """
    A TOML table whose keys are taken one by one; what is left over is unknown.

    Parameters
    ----------
    table : mapping
        Parsed TOML.
    source : str
        File, and name of the table inside it, for messages.
    """

    def __init__(self, table: Mapping[str, Any], source: str) -> None:
        self._table = table
        self.source = source
        self._asked: list[str] = []

    def keys(self) -> list[str]:
        """Return the keys of the table."""
        return list(self._table)

    def _take(self, key: str, default: Any) -> Any:
        self._asked.append(key)
        if key not in self._table and default is _MISSING:
            raise UsageError(f"{self.source}: '{key}' is missing")
        return self._table.get(key, default)

    def _refuse(self, key: str, value: object, allowed: str) -> UsageError:
        return UsageError(f"{self.source}: {key} must be {allowed}, not {value!r}")

    def text(self, key: str, default: str = _MISSING) -> str:
        """Take a string; one without a default must not be empty."""
        value = self._take(key, default)
        if not isinstance(value, str) or (default is _MISSING and not value):
            raise self._refuse(key, value, "a string")
        return value

    def choice(self, key: str, default: str, allowed: Sequence[str]) -> str:
        """Take one of a few strings."""
        value = self._take(key, default)
        if value not in allowed:
            raise self._refuse(key, value, " or ".join(f"'{word}'" for word in allowed))
        return str(value)

    def texts(self, key: str, default: Sequence[str]) -> tuple[str, ...]:
        """Take a list of strings that is not empty."""
        value = self._take(key, default)
        good = isinstance(value, list | tuple) and value and all(isinstance(t, str) for t in value)
        if not good:
            raise self._refuse(key, value, "a list of strings")
        return tuple(value)

    def integer(self, key: str, default: int = _MISSING, *, least: int) -> int:
        """Take an integer of at least `least`."""
        value = self._take(key, default)
        if not isinstance(value, int) or isinstance(value, bool) or value < least:
            raise self._refuse(key, value, f"an integer of at least {least}")
        return value

    def number(
        self,
        key: str,
        default: float = _MISSING,
        *,
        positive: bool = False,
        below: float = math.inf,
    ) -> float:
        """Take a number that is not negative, or positive, and below a bound."""
        value = self._take(key, default)
        if not _is_number(value) or not 0.0 <= value < below or (positive and value == 0.0):
            kind = "a positive number" if positive else "a number >= 0"
            bound = f" and < {below:g}" if below < math.inf else ""
            raise self._refuse(key, value, kind + bound)
        return float(value)

    def flag(self, key: str, default: bool) -> bool:
        """Take true or false."""
        value = self._take(key, default)
        if not isinstance(value, bool):
            raise self._refuse(key, value, "true or false")
        return value

    def vector(
        self, key: str, default: tuple[float, float, float] = _MISSING
    ) -> tuple[float, float, float]:
        """Take three numbers."""
        x, y, z = self._numbers(key, 3, "three", self._take(key, default))
        return x, y, z

    def numbers(self, key: str, count: int) -> tuple[float, ...] | None:
        """Take so many numbers; None where there are none."""
        value = self._take(key, None)
        return None if value is None else self._numbers(key, count, str(count), value)

    def _numbers(self, key: str, count: int, word: str, value: Any) -> tuple[float, ...]:
        good = (
            isinstance(value, list | tuple)
            and len(value) == count
            and all(_is_number(x) for x in value)
        )
        if not good:
            raise self._refuse(key, value, f"{word} finite numbers")
        return tuple(float(x) for x in value)

    def table(self, key: str) -> Reader:
        """Take a table."""
        value = self._take(key, _MISSING)
        if not isinstance(value, Mapping):
            raise self._refuse(key, value, "a table")
        return Reader(value, f"{self.source} [{key}]")

    def rest(self) -> dict[str, bool | int | float | str]:
        """Take all keys not asked for, as plain values."""
        left = {key: value for key, value in self._table.items() if key not in self._asked}
        for key, value in left.items():
            if not isinstance(value, bool | int | float | str):
                raise self._refuse(key, value, "a number, a string, true or false")
        return left

    def finish(self) -> None:
        """Refuse keys that nobody asked for."""
        unknown = [key for key in self._table if key not in self._asked]
        if unknown:
            known = ", ".join(dict.fromkeys(self._asked))
            raise UsageError(f"{self.source}: unknown key '{unknown[0]}'; known are {known}")
