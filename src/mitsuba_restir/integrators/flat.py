"""Plain data as a flat list, and back: what is passed to Dr.Jit's recordings.

Dr.Jit 1.5 goes through dataclasses by asking Python for their type hints, and holds its own lock
while Python does. If Python passes to a thread that waits for that lock, both wait for ever. With
lists it never leaves C++, and is faster.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any

Structure = Any
"""How a value is made of its leaves: its type and the structures of its parts; None for a leaf."""


def flatten(value: Any, leaves: list[Any]) -> Structure:
    """Append the leaves of a value to ``leaves`` and return how it is made of them.

    Dataclasses, lists and tuples have parts; everything else is a leaf.
    """
    kind: Any = type(value)
    names = _field_names(kind)
    if names is not None:
        return kind, tuple(flatten(getattr(value, name), leaves) for name in names)
    if kind in (list, tuple):
        return kind, tuple(flatten(part, leaves) for part in value)
    leaves.append(value)
    return None


def unflatten(structure: Structure, leaves: Iterator[Any]) -> Any:
    """The value of a structure, made of the next leaves."""
    if structure is None:
        return next(leaves)
    kind, parts = structure
    values = [unflatten(part, leaves) for part in parts]
    return kind(values) if kind in (list, tuple) else kind(*values)


@cache
def _field_names(kind: Any) -> tuple[str, ...] | None:
    return tuple(field.name for field in fields(kind)) if is_dataclass(kind) else None
