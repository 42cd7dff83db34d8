"""The integrator's parameters as text: what ``-p name=value`` and ``--aovs`` accept.

Only names and types are known here; which values are allowed is the plugin's own business.
"""

from __future__ import annotations

from collections.abc import Mapping

from ..errors import UsageError

Value = bool | int | float | str

PARAMETERS: Mapping[str, type] = {
    "max_depth": int,
    "rr_depth": int,
    "hide_emitters": bool,
    "temporal": bool,
    "spatial": bool,
    "spatial_neighbors": int,
    "spatial_radius": float,
    "spatial_rounds": int,
    "confidence_cap": float,
    "shift": str,
    "connectability": str,
    "neighbor_sampling": str,
    "retrace_history": bool,
    "mutations": int,
    "mutation_step": float,
    "mutation_interval": int,
    "blue_noise": str,
    "blue_noise_weight": float,
    "blue_noise_seeds": bool,
}
"""Types of the parameters of ``restir_pt``."""

_DESCRIPTIONS = {bool: "true or false", int: "an integer", float: "a number", str: "a word"}


def _convert(text: str, kind: type) -> Value | None:
    if kind is bool:
        return {"true": True, "false": False}.get(text.lower())
    try:
        return kind(text) if text else None
    except ValueError:
        return None


def parse_parameters(texts: Mapping[str, str]) -> dict[str, Value]:
    """
    Convert ``-p`` assignments to the integrator's parameters.

    Raises
    ------
    UsageError
        An unknown name or a value of the wrong type; says what is allowed.
    """
    values: dict[str, Value] = {}
    for name, text in texts.items():
        if name not in PARAMETERS:
            raise UsageError(
                f"argument -p: restir_pt has no parameter '{name}'; it has {', '.join(PARAMETERS)}"
            )
        value = _convert(text.strip(), PARAMETERS[name])
        if value is None:
            kind = _DESCRIPTIONS[PARAMETERS[name]]
            raise UsageError(f"argument -p: {name} must be {kind}, not '{text}'")
        values[name] = value
    return values


def parse_aovs(text: str) -> dict[str, str]:
    """
    Convert ``type`` or ``name:type`` entries, separated by commas, to {name: type}.

    Raises
    ------
    UsageError
        An empty name or type, or a name used twice.
    """
    aovs: dict[str, str] = {}
    for entry in text.split(","):
        name, colon, kind = (part.strip() for part in entry.partition(":"))
        if not name or (colon and not kind):
            raise UsageError(f"argument --aovs: '{entry}' must be a type or name:type")
        if name in aovs or name in ("R", "G", "B"):
            raise UsageError(f"argument --aovs: the name '{name}' is taken")
        aovs[name] = kind or name
    return aovs
