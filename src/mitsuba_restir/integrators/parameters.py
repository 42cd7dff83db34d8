"""The parameters of ``restir_pt``: read from Mitsuba properties and checked at the border."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

from ..passes.neighbors import SAMPLING
from ..passes.shade import AOV_CHANNELS
from ..paths.record import MAX_EDGES

MUTATION_STEP = 0.05
"""Default width of a mutation in primary sample space."""


@dataclass(frozen=True)
class Parameters:
    """Checked parameters; the meaning of each is in the plugin's reference page."""

    max_depth: int
    rr_depth: int
    hide_emitters: bool
    temporal: bool
    spatial: bool
    spatial_neighbors: int
    spatial_radius: float
    spatial_rounds: int
    neighbor_sampling: str
    confidence_cap: float
    shift: str
    connectability: str
    retrace_history: bool
    mutations: int
    mutation_step: float
    mutation_interval: int
    blue_noise: str
    blue_noise_weight: float
    blue_noise_seeds: bool
    aovs: tuple[tuple[str, str], ...]

    @property
    def biased(self) -> tuple[str, ...]:
        """What was asked for that biases the image, as ``name=value``."""
        rule = self.blue_noise in RULE and self.blue_noise_weight > 0
        biased = rule or self.blue_noise == SELECTION
        return (f"blue_noise={self.blue_noise}",) if biased else ()


RULE = ("mutation", "mutation_updated")
"""Values of ``blue_noise`` that name the source document's rule for mutations."""

SELECTION = "selection"
"""Value of ``blue_noise`` that chooses what is shown."""

_CHOICES = {
    "shift": ("hybrid", "reconnection", "random_replay"),
    "connectability": ("footprint", "distance_roughness"),
    "neighbor_sampling": tuple(SAMPLING),
    "blue_noise": ("none", *RULE, SELECTION),
}


def read_parameters(props: Any) -> Parameters:
    """Read and check the plugin's properties.

    Raises
    ------
    ValueError
        For an unknown name or a value outside the allowed range, naming what is allowed.
    """
    max_depth = _integer(props, "max_depth", -1, -1)
    parameters = Parameters(
        max_depth=MAX_EDGES if max_depth == -1 else min(max_depth, MAX_EDGES),
        rr_depth=_integer(props, "rr_depth", 5, 1),
        hide_emitters=_boolean(props, "hide_emitters", False),
        temporal=_boolean(props, "temporal", True),
        spatial=_boolean(props, "spatial", True),
        spatial_neighbors=_integer(props, "spatial_neighbors", 3, 1, 32),
        spatial_radius=_number(props, "spatial_radius", 20.0, 1.0, 256.0),
        spatial_rounds=_integer(props, "spatial_rounds", 1, 1, 16),
        neighbor_sampling=_choice(props, "neighbor_sampling", "random"),
        confidence_cap=_number(props, "confidence_cap", 20.0, 0.0, 1e6),
        shift=_choice(props, "shift", "hybrid"),
        connectability=_choice(props, "connectability", "footprint"),
        retrace_history=_boolean(props, "retrace_history", False),
        mutations=_integer(props, "mutations", 0, 0, 1000),
        mutation_step=_number(props, "mutation_step", MUTATION_STEP, 1e-4, 1.0),
        mutation_interval=_integer(props, "mutation_interval", 1, 1, 64),
        blue_noise=_choice(props, "blue_noise", "none"),
        blue_noise_weight=_number(props, "blue_noise_weight", 0.5, 0.0, 1.0),
        blue_noise_seeds=_boolean(props, "blue_noise_seeds", False),
        aovs=_aovs(props.get("aovs", "")),
    )
    if unknown := props.unqueried():
        known = ", ".join(field.name for field in fields(Parameters))
        raise ValueError(f"restir_pt has no parameter '{unknown[0]}'; it has {known}")
    if parameters.blue_noise in RULE and parameters.mutations == 0:
        raise ValueError(
            f"restir_pt: blue_noise={parameters.blue_noise!r} is a rule for mutations and needs "
            "mutations of at least 1, not 0"
        )
    if parameters.blue_noise == SELECTION and not (parameters.temporal and parameters.spatial):
        raise ValueError(
            "restir_pt: blue_noise='selection' chooses among what spatial reuse computes, by what "
            "earlier frames showed, and needs temporal=true and spatial=true"
        )
    if "history" in dict(parameters.aovs).values() and parameters.blue_noise != SELECTION:
        raise ValueError("restir_pt: the aov type history needs blue_noise='selection'")
    if parameters.blue_noise in RULE and parameters.mutation_interval > 1:
        raise ValueError(
            f"restir_pt: blue_noise={parameters.blue_noise!r} mutates every pixel in every frame "
            f"and needs mutation_interval=1, not {parameters.mutation_interval}"
        )
    return parameters


def _reject(name: str, value: Any, allowed: str) -> ValueError:
    return ValueError(f"restir_pt: {name} must be {allowed}, not {value!r}")


def _integer(props: Any, name: str, default: int, low: int, high: int = 2**31 - 1) -> int:
    value = props.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        bound = f"of at least {low}" if high == 2**31 - 1 else f"from {low} to {high}"
        raise _reject(name, value, f"an integer {bound}")
    return value


def _number(props: Any, name: str, default: float, low: float, high: float) -> float:
    value = props.get(name, default)
    good = isinstance(value, int | float) and not isinstance(value, bool)
    if not good or not low <= value <= high:
        bound = f"of at least {low:g}" if math.isinf(high) else f"from {low:g} to {high:g}"
        raise _reject(name, value, f"a number {bound}")
    return float(value)


def _boolean(props: Any, name: str, default: bool) -> bool:
    value = props.get(name, default)
    if not isinstance(value, bool):
        raise _reject(name, value, "true or false")
    return value


def _choice(props: Any, name: str, default: str) -> str:
    value = props.get(name, default)
    if value not in _CHOICES[name]:
        raise _reject(name, value, "one of " + ", ".join(_CHOICES[name]))
    return str(value)


def _aovs(text: Any) -> tuple[tuple[str, str], ...]:
    """Parse ``"name:type, ..."`` as Mitsuba's ``aov`` does; a bare type is its own name."""
    pairs = []
    for item in filter(None, (part.strip() for part in str(text).split(","))):
        name, _, kind = item.partition(":")
        kind = kind or name
        if kind not in AOV_CHANNELS:
            raise _reject("aovs", item, "a list of name:type with types " + ", ".join(AOV_CHANNELS))
        pairs.append((name, kind))
    return tuple(pairs)
