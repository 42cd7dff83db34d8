"""What is shown: plain data that pages change and the worker reads, replaced as a whole."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from ..integrators.declaration import Value
from ..integrators.parameters import PARAMETERS
from ..integrators.presets import PRESETS

SET_BY_PRESETS = frozenset(name for values in PRESETS.values() for name in values)
"""Parameters that presets are about: choosing one forgets what was set of them."""

COLOUR = "colour"
"""The view that is shown unless another is asked for."""


@dataclass(frozen=True)
class Side:
    """
    One configuration; two of them can be compared.

    Attributes
    ----------
    parameters : mapping
        Of ``restir_pt``, where they are not the defaults.
    spp : int
        Candidate paths per pixel and frame.
    view : str
        What of its frames is shown: a name of :data:`.views.VIEWS`.
    """

    parameters: Mapping[str, Value] = field(default_factory=dict)
    spp: int = 1
    view: str = COLOUR

    @property
    def rendered(self) -> tuple[object, ...]:
        """What its frames depend on; sides that agree in it share them."""
        return (self.spp, *sorted(self.parameters.items()))

    def value(self, name: str) -> Value:
        """Value of a parameter, whoever has set it."""
        return effective(self.parameters)[name]


@dataclass(frozen=True)
class Settings:
    """
    All that pages can set, the camera apart.

    Attributes
    ----------
    sides : (Side, Side)
        A, which is always shown, and B, which is compared with it.
    compare : bool
    exposure : float
        Of colours, in stops.
    fps : float
        Frames a second that are held while something moves, by fewer pixels; 0: all pixels always.
    accumulate : bool
        Whether the picture becomes a still when the camera rests.
    frozen : bool
    """

    sides: tuple[Side, Side] = (Side(), Side())
    compare: bool = False
    exposure: float = 0.0
    fps: float = 15.0
    accumulate: bool = True
    frozen: bool = False

    @property
    def shown(self) -> tuple[Side, ...]:
        """The sides that are on the screen."""
        return self.sides if self.compare else self.sides[:1]

    def with_side(self, index: int, side: Side) -> Settings:
        """With another side A (0) or B (1)."""
        a, b = self.sides
        return replace(self, sides=(side, b) if index == 0 else (a, side))


def effective(parameters: Mapping[str, Value]) -> dict[str, Value]:
    """The value of every parameter, given those that are not the defaults."""
    preset = PRESETS[str(parameters.get("preset", PARAMETERS["preset"].default))]
    defaults = {name: entry.default for name, entry in PARAMETERS.items()}
    return {**defaults, **preset, **parameters}


def with_parameter(side: Side, name: str, value: Value) -> Side:
    """
    A side with another value of a parameter.

    Raises
    ------
    ValueError
        There is no such parameter, or the value is not allowed.
    """
    if name not in PARAMETERS:
        raise ValueError(f"restir_pt has no parameter '{name}'")
    value = PARAMETERS[name].check(value)
    forgotten = {name} | (set(SET_BY_PRESETS) if name == "preset" else set())
    kept = {key: given for key, given in side.parameters.items() if key not in forgotten}
    if effective(kept)[name] != value:
        kept[name] = value
    return replace(side, parameters=kept)
