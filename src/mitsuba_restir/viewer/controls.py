"""The controls of the parameters, made from their one declaration."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from ..integrators.declaration import LARGEST, Parameter, Value
from ..integrators.parameters import PARAMETERS

Kind = Literal["switch", "select", "slider", "number"]

HIDDEN = ("aovs", "preset")
"""Views stand for the first; the second is chosen above the others."""

GROUPS: Mapping[str, tuple[str, ...]] = {
    "Reuse": (
        "temporal",
        "confidence_cap",
        "retrace_history",
        "spatial",
        "spatial_*",
        "neighbor_*",
    ),
    "Shifts": ("shift", "connectability"),
    "Candidates": ("max_depth", "rr_depth", "roulette", "guiding", "hide_emitters"),
    "Mutations": ("mutation*",),
    "Blue noise": ("blue_noise*",),
}
"""Names, or their beginnings, by group; what is in none comes last."""

OTHERS = "More"

STEPS = 200
"""Positions of a slider of fractions."""

WIDEST = 300.0
"""Range of numbers, from lowest to highest, that a slider has."""


@dataclass(frozen=True)
class Control:
    """
    How a parameter is set in the page.

    Attributes
    ----------
    parameter : Parameter
    kind : str
    title, help : str
    """

    parameter: Parameter
    kind: Kind
    title: str
    help: str

    @property
    def logarithmic(self) -> bool:
        """Whether equal ways of the slider are equal factors."""
        low, high = self.parameter.low, self.parameter.high
        return self.parameter.kind is float and low > 0 and high / low >= 100

    @property
    def positions(self) -> tuple[float, float, float]:
        """First, last, and distance of a slider's positions."""
        low, high = self.parameter.low, self.parameter.high
        if self.parameter.kind is int:
            return low, high, 1
        return 0, STEPS, 1

    def position(self, value: float) -> float:
        """Where on the slider a value is."""
        low, high = self.parameter.low, self.parameter.high
        if self.parameter.kind is int:
            return value
        if self.logarithmic:
            return STEPS * math.log(value / low) / math.log(high / low)
        return STEPS * (value - low) / (high - low)

    def value(self, position: float) -> Value:
        """The value at a position, in three digits."""
        low, high = self.parameter.low, self.parameter.high
        if self.parameter.kind is int:
            return round(position)
        share = position / STEPS
        found = low * (high / low) ** share if self.logarithmic else low + (high - low) * share
        return min(max(float(f"{found:.3g}"), low), high)


def control_of(parameter: Parameter) -> Control:
    """The control of a parameter."""
    return Control(parameter, _kind(parameter), _title(parameter.name), plain(parameter.doc))


def grouped() -> dict[str, list[Control]]:
    """Controls of all parameters by group, in the order in which they are declared."""
    groups: dict[str, list[Control]] = {name: [] for name in (*GROUPS, OTHERS)}
    for name, parameter in PARAMETERS.items():
        if name not in HIDDEN:
            groups[_group(name)].append(control_of(parameter))
    return {name: found for name, found in groups.items() if found}


def plain(text: str) -> str:
    """Documentation without the marks of reStructuredText."""
    text = re.sub(r":[\w:]+:`([^`<]+?)(?: <[^>]*>)?`", r"\1", text)
    return text.replace("``", "").replace("**", "")


def _kind(parameter: Parameter) -> Kind:
    if parameter.kind is bool:
        return "switch"
    if parameter.choices:
        return "select"
    bounded = parameter.high != LARGEST and parameter.high - parameter.low <= WIDEST
    return "slider" if bounded else "number"


def _group(name: str) -> str:
    for group, patterns in GROUPS.items():
        for pattern in patterns:
            if name == pattern or (pattern.endswith("*") and name.startswith(pattern[:-1])):
                return group
    return OTHERS


def _title(name: str) -> str:
    words = name.replace("_", " ").replace("rr ", "roulette ").replace("neighbor", "neighbour")
    return words[0].upper() + words[1:]
