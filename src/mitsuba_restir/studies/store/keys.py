"""What images depend on, as digests: whose finished runs and references a study may use.

A finished run carries the digest of the study that rendered it. Variants may be added later: the
folder remembers every digest with the variants that it stood for, and a run is used where its own
variant is still the same.
"""

from __future__ import annotations

import hashlib
import json
import re
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any

from ...cache import cache_folder
from ..config.study import Size, Study
from ..config.tables import to_table
from ..runs.scene import expand

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

# Seconds; writing a batch takes less than one.
_LEFT_AFTER = 3600.0

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
    return _digest(rendering_table(study))


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


def reference_digest(study: Study, size: Size, scene: str) -> str:
    """
    Digest of everything that a batch of a reference depends on, but for its number.

    Parameters
    ----------
    scene : str
        The scene's digest.
    """
    assert study.reference is not None
    content = {
        "scene": scene,
        "view": None if study.view is None else asdict(study.view),
        "size": list(size),
        "max_depth": study.max_depth,
        "spp": study.reference.batch_spp,
        "variant": study.mitsuba_variant,
        "mitsuba": metadata.version("mitsuba"),
        **({} if study.crop is None else {"crop": list(study.crop)}),
        **({"seconds": study.reference.seconds} if study.reference.seconds else {}),
    }
    return _digest(content)


def reference_key(study: Study) -> str:
    """Digest of which reference a study has: its settings and its files; empty without one."""
    if study.reference is None:
        return ""
    files = filter(None, (study.reference.file, study.reference.variance))
    return _digest(asdict(study.reference), *(Path(expand(file)).read_bytes() for file in files))


def reference_folder(study: Study, size: Size, digest: str) -> Path:
    """Folder of the batches of a study's reference that has a digest."""
    name = re.sub(r"\W+", "-", Path(study.scene).stem or "scene")
    return cache_folder("references") / f"{name}-{size[0]}x{size[1]}-{digest[:16]}"


def remove_leftovers() -> None:
    """Remove what processes that were killed have left half written in the cache."""
    for file in cache_folder("references").rglob(".*.partial"):
        # Other processes may be writing right now, or have removed it.
        with suppress(OSError):
            if time.time() - file.stat().st_mtime > _LEFT_AFTER:
                file.unlink()


def _digest(content: object, *files: bytes) -> str:
    text = json.dumps(content, sort_keys=True).encode()
    return hashlib.sha256(b"".join([text, *files])).hexdigest()
