"""Which studies rendered into a folder, and whose finished runs another one may use.

A finished run carries the digest of the study that rendered it. Variants may be added later: the
folder remembers every digest with the variants that it stood for, and a run is used where its own
variant is still the same.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..config.study import Study
from ..config.tables import to_table

FILE = "studies.json"

# These decide how much is rendered or what is measured, not what a finished run looks like.
# References have keys of their own.
_FREE_KEYS = frozenset(
    {
        "runs",
        "probe_runs",
        "quantities",
        "baseline",
        "epsilon",
        "trim",
        "about",
        "published",
        "reference",
    }
)

Variants = Mapping[str, Mapping[str, Any]]


def rendering_table(study: Study) -> dict[str, Any]:
    """Return what the images of a study depend on, as a TOML table."""
    table = {key: value for key, value in to_table(study).items() if key not in _FREE_KEYS}
    table["variants"] = {name: table["variants"][name] for name in study.rendered()}
    for variant in table["variants"].values():
        variant.pop("baseline", None)
    return table


def digest_of(study: Study) -> str:
    """Return the digest that finished runs of a study carry."""
    return hashlib.sha256(json.dumps(rendering_table(study), sort_keys=True).encode()).hexdigest()


def differences(study: Study, other: Study) -> list[str]:
    """Name the settings in which two studies cannot share a folder; new variants are none."""
    mine, theirs = rendering_table(study), rendering_table(other)
    own, others = mine.pop("variants"), theirs.pop("variants")
    found = {key for key in mine.keys() | theirs.keys() if mine.get(key) != theirs.get(key)}
    if any(own[name] != others[name] for name in own.keys() & others.keys()):
        found.add("variants")
    return sorted(found)


def read_history(folder: Path) -> dict[str, Variants]:
    """Return the variants of every study that rendered into a folder, by digest."""
    try:
        history: dict[str, Variants] = json.loads((folder / FILE).read_text("utf-8"))
        # What is no table of tables would be no use.
        return {str(digest): dict(variants) for digest, variants in history.items()}
    except (OSError, ValueError, TypeError, AttributeError):
        return {}


def entry(study: Study) -> dict[str, Variants]:
    """Return a study's own entry of a history."""
    return {digest_of(study): rendering_table(study)["variants"]}


def usable_digests(history: Mapping[str, Variants], study: Study, variant: str) -> list[str]:
    """Return the digests whose runs of a variant are what this study would render, if it is."""
    own = rendering_table(study)["variants"].get(variant)
    if own is None:
        return []
    return [digest for digest, variants in history.items() if variants.get(variant) == own]
