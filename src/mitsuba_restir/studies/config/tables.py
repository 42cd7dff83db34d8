"""Studies as TOML tables: read with one line for what is wrong, written with every default."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, fields
from typing import Any

from pydantic import TypeAdapter, ValidationError

from ...errors import UsageError
from .study import Motion, Reference, Study, Variant, View
from .values import KIND

_STUDIES = TypeAdapter(Study)
_TABLES: Mapping[str, type[Any]] = {"view": View, "motion": Motion, "reference": Reference}


def to_table(study: Study) -> dict[str, Any]:
    """Return the study as a complete TOML table, defaults included."""
    table: dict[str, Any] = json.loads(json.dumps(asdict(study)))
    table["sizes"] = [f"{width}x{height}" for width, height in study.sizes]
    table["variants"] = {name: _variant_table(v) for name, v in study.variants.items()}
    # These came later: studies without them keep the digests of their finished runs.
    if study.stride == 1:
        del table["stride"]
    if study.reference is not None and not study.reference.noise:
        del table["reference"]["noise"]
    if study.reference is not None and not study.reference.seconds:
        del table["reference"]["seconds"]
    if study.motion is not None and study.motion.cut_from is None:
        del table["motion"]["cut_from"]
        if not study.motion.light:
            table["motion"] = {"step": list(study.motion.step)}
    return {key: value for key, value in table.items() if value is not None}


def _variant_table(variant: Variant) -> dict[str, Any]:
    made = {"of": variant.of, "blur_to": variant.blur_to}
    rendered = {"type": variant.type, "spp": variant.spp, **variant.parameters}
    optional = {"shows": variant.shows, "denoise": variant.denoise, "baseline": variant.baseline}
    return {
        **(made if variant.of else rendered),
        **{name: value for name, value in optional.items() if value},
    }


def from_table(table: Mapping[str, Any], source: str) -> Study:
    """
    Build a study from a TOML table.

    Parameters
    ----------
    table : mapping
        Parsed TOML.
    source : str
        Where it comes from, for messages.

    Raises
    ------
    UsageError
        A key is missing, unknown or of the wrong kind; says which and what is allowed.
    """
    try:
        return _STUDIES.validate_python(table)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = source + _tables(table, first["loc"])
        raise UsageError(f"{where}: {_what(first)}") from error


def _tables(table: object, place: tuple[int | str, ...]) -> str:
    """Name the tables, one inside the other, that lead to a place."""
    inner = table.get(place[0]) if place and isinstance(table, Mapping) else None
    return f" [{place[0]}]{_tables(inner, place[1:])}" if isinstance(inner, Mapping) else ""


def _what(error: Any) -> str:
    """Say what is wrong with a key, as pydantic describes it."""
    key, place = error["loc"][-1], error["loc"][0]
    match error["type"]:
        case "missing":
            return f"'{key}' is missing"
        case "unexpected_keyword_argument":
            owner = Study if key == place else _TABLES[place]
            known = ", ".join(field.name for field in fields(owner))
            return f"unknown key '{key}'; known are {known}"
        case "value_error":
            return str(error["ctx"]["error"])
        case "literal_error":
            return f"{key} must be {error['ctx']['expected']}, not {error['input']!r}"
        case kind if kind == KIND:
            return f"{key} {error['msg']}"
    return f"{key} must be a table, not {error['input']!r}"
