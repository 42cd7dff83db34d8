"""Study files: reading TOML from disk or from the package, and changing single keys."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import tomli_w

from ...errors import UsageError, one_line
from .study import Study
from .tables import from_table, to_table

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


_EXPERIMENTS = resources.files("mitsuba_restir.studies") / "experiments"

OF_A_SCENE = ("view", "crop")
"""Keys that say what is seen of a scene, and mean nothing in another one."""


def packaged_studies() -> list[str]:
    """Return the names of the studies that come with the package."""
    return sorted(
        f.name.removesuffix(".toml") for f in _EXPERIMENTS.iterdir() if f.name.endswith(".toml")
    )


def load_study(
    source: str, changes: Sequence[str] = (), adapt: Callable[[Study], Study] | None = None
) -> Study:
    """
    Read a study.

    Parameters
    ----------
    source : str
        Path of a TOML file, or name of a packaged study. A key ``base`` names another study, whose
        keys it has where it does not give them itself: a file beside it, or a packaged one. Where
        it names a scene, its base's ``view`` and ``crop`` are none of its own.
    changes : sequence of str
        ``key=value`` with a TOML value (or plain text), applied on top; dots enter tables, as in
        ``variants.restir.spp=4``.
    adapt : callable, optional
        Changes the study as a whole; of what it changes, the keys in `changes` stay.

    Raises
    ------
    UsageError
        There is no such study, it is no TOML, or its content is wrong.
    """
    study = _changed(_table(source), changes, source)
    return study if adapt is None else _changed(to_table(adapt(study)), changes, source)


def dump_study(study: Study) -> bytes:
    """Return the study as TOML, with every default written out."""
    return tomli_w.dumps(to_table(study)).encode()


def _table(source: str, descendants: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return a study's table with what it has from its base, and from the base of that."""
    try:
        table = tomllib.loads(_text(source))
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"{source} is no TOML: {one_line(error)}") from error
    base = table.pop("base", None)
    if base is None:
        return table
    if not isinstance(base, str):
        raise UsageError(f"{source}: base must be a string, not {base!r}")
    beside = Path(source).parent / base
    found = str(beside) if beside.is_file() else base
    family = (*descendants, source)
    if found in family:
        raise UsageError(f"{source}: base = '{base}' leads back to itself")
    inherited = _table(found, family)
    if "scene" in table:
        inherited = {key: inherited[key] for key in inherited if key not in OF_A_SCENE}
    return {**inherited, **table}


def _text(source: str) -> str:
    path = Path(source)
    if not path.is_file():
        if source not in packaged_studies():
            raise UsageError(
                f"'{source}' is neither a file nor a study of the package "
                f"({', '.join(packaged_studies())})"
            )
        return (_EXPERIMENTS / f"{source}.toml").read_text("utf-8")
    try:
        return path.read_text("utf-8")
    except (OSError, UnicodeError) as error:
        raise UsageError(f"cannot read {path}: {one_line(error)}") from error


def _changed(table: dict[str, Any], changes: Sequence[str], source: str) -> Study:
    known = list(_variants(table))
    for change in changes:
        _change(table, change)
    for name, variant in _variants(table).items():
        if name not in known and isinstance(variant, dict) and not {"type", "of"} & variant.keys():
            raise UsageError(
                f"{source}: no variant '{name}' to change: there are {', '.join(known)}"
            )
    return from_table(table, source)


def _variants(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return the variants of a table that has not been checked yet."""
    found = table.get("variants")
    return found if isinstance(found, dict) else {}


def _change(table: dict[str, Any], change: str) -> None:
    key, equals, text = change.partition("=")
    names = [name.strip() for name in key.split(".")]
    if not equals or not all(names):
        raise UsageError(f"'{change}' must be key=value, as in runs=4 or variants.path.spp=2")
    for name in names[:-1]:
        table = table.setdefault(name, {})
        if not isinstance(table, dict):
            raise UsageError(f"'{change}': '{name}' is no table")
    try:
        table[names[-1]] = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        table[names[-1]] = text.strip()
