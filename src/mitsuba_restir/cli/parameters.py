"""The integrator's parameters as text: what ``-p name=value`` and ``--aovs`` accept.

Only names and types are known here; which values are allowed is the plugin's own business.
"""

from __future__ import annotations

from collections.abc import Mapping

from ..errors import UsageError
from ..integrators.declaration import Value
from ..integrators.parameters import PARAMETERS as DECLARED

PARAMETERS = {name: entry for name, entry in DECLARED.items() if name != "aovs"}
"""Declarations of the parameters that ``-p`` sets; auxiliary images have an option of their own."""


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
        value = PARAMETERS[name].parse(text.strip())
        if value is None:
            raise UsageError(f"argument -p: {name} must be {PARAMETERS[name].noun}, not '{text}'")
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
