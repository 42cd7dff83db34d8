"""What a parameter is declared with, once, and what is read from that: values, errors, a manual."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, dataclass, field, fields
from typing import Any, TypeVar

Value = bool | int | float | str
V = TypeVar("V", bool, int, float, str)

LARGEST = 2**31 - 1
"""Integers up to here are what Mitsuba's scene files can say."""

_NOUNS = {bool: "true or false", int: "an integer", float: "a number", str: "a word"}
_TYPES = {bool: "|bool|", int: "|int|", float: "|float|", str: "|string|"}


def _never(_: Any) -> bool:
    return False


@dataclass(frozen=True)
class Parameter:
    """
    Declaration of a plugin's parameter.

    Attributes
    ----------
    name : str
    default : bool, int, float or str
        Has the parameter's type.
    doc : str
        What it means, in reStructuredText.
    low, high : float
        Smallest and largest number allowed.
    choices : tuple of str
        Words allowed; any, where there are none.
    former : mapping of str to str
        Words of earlier versions, and what to write in their place.
    biased : callable
        Whether the image is biased by it, given all parameters.
    """

    name: str
    default: Value
    doc: str
    low: float = 0
    high: float = LARGEST
    choices: tuple[str, ...] = ()
    former: Mapping[str, str] = field(default_factory=dict)
    biased: Callable[[Any], bool] = _never

    @property
    def kind(self) -> type:
        """Type of its values."""
        return type(self.default)

    @property
    def noun(self) -> str:
        """What its values are, whichever of them are allowed."""
        return _NOUNS[self.kind]

    @property
    def allowed(self) -> str:
        """Which values are allowed, as errors say it."""
        if self.choices:
            return "one of " + ", ".join(self.choices)
        if self.kind not in (int, float):
            return self.noun
        of = "" if self.range.startswith("from") else "of "
        return f"{self.noun} {of}{self.range}"

    @property
    def range(self) -> str:
        """Which numbers are allowed."""
        if self.high == LARGEST:
            return f"at least {self.low:g}"
        return f"from {self.low:g} to {self.high:g}"

    def check(self, value: Any) -> Value:
        """
        Return an allowed value with the parameter's type.

        Raises
        ------
        ValueError
            It is not allowed; says what is.
        """
        number = self.kind in (int, float)
        accepted = (int, float) if self.kind is float else self.kind
        good = isinstance(value, accepted) and (isinstance(value, bool) == (self.kind is bool))
        if good and number:
            good = self.low <= value <= self.high
        if good and self.choices:
            good = value in self.choices
        if not good:
            raise self.refusal(value)
        return self.kind(value)

    def refusal(self, value: Any, allowed: str | None = None) -> ValueError:
        """The error for a value that is not allowed."""
        now = self.former.get(value) if isinstance(value, str) else None
        hint = f"; write {now}" if now else ""
        return ValueError(
            f"restir_pt: {self.name} must be {allowed or self.allowed}, not {value!r}{hint}"
        )

    def parse(self, text: str) -> Value | None:
        """Convert a word of a command line; None where it does not have the parameter's type."""
        if self.kind is bool:
            return {"true": True, "false": False}.get(text.lower())
        try:
            return self.kind(text) if text else None
        except ValueError:
            return None

    def entry(self) -> str:
        """Its entry in the table of the plugin's reference page, as in Mitsuba's own pages."""
        limits = f"; {self.range}" if self.kind in (int, float) else ""
        text = f"{self.doc} (Default: {_literal(self.default)}{limits})"
        lines = textwrap.wrap(text, 92, break_long_words=False, break_on_hyphens=False)
        body = "\n".join(["- " + lines[0], *(f"  {line}" for line in lines[1:])])
        return f"* - {self.name}\n" + textwrap.indent(f"- {_TYPES[self.kind]}\n{body}", "  ")


def _literal(value: Value) -> str:
    if isinstance(value, bool):
        return f"|{str(value).lower()}|"
    if isinstance(value, str):
        return f"``{value}``" if value else "none"
    return f"{value:g}"


def declared(default: V, doc: str, **more: Any) -> V:
    """A field of a dataclass of parameters; the arguments are those of :class:`Parameter`."""
    return field(default=default, metadata={"doc": " ".join(doc.split()), **more})


def declarations(parameters: type) -> dict[str, Parameter]:
    """Return the declaration of each field of a dataclass, by name."""
    return {
        entry.name: Parameter(entry.name, entry.default, **entry.metadata)
        for entry in fields(parameters)
        if entry.default is not MISSING
    }


def page(table: Iterable[Parameter]) -> str:
    """Parameters as a ``pluginparameters`` directive of Mitsuba's documentation."""
    entries = "\n\n".join(parameter.entry() for parameter in table)
    return ".. pluginparameters::\n\n" + textwrap.indent(entries, " ")
