"""References that are rendered once for all studies: their place, and the key of their content."""

from __future__ import annotations

import hashlib
import json
import re
import time
from contextlib import suppress
from dataclasses import asdict
from importlib import metadata
from pathlib import Path

from ...cache import cache_folder
from ..config.study import Size, Study
from ..runs.scene import expand

# Seconds; writing a batch takes less than one.
_LEFT_AFTER = 3600.0


def remove_leftovers() -> None:
    """Remove what processes that were killed have left half written in the cache."""
    for file in cache_folder("references").rglob(".*.partial"):
        # Other processes may be writing right now, or have removed it.
        with suppress(OSError):
            if time.time() - file.stat().st_mtime > _LEFT_AFTER:
                file.unlink()


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
        "spp": study.reference.spp // study.reference.batches,
        "variant": study.mitsuba_variant,
        "mitsuba": metadata.version("mitsuba"),
        **({} if study.crop is None else {"crop": list(study.crop)}),
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def reference_key(study: Study) -> str:
    """Digest of which reference a study has: its settings and its files; empty without one."""
    if study.reference is None:
        return ""
    digest = hashlib.sha256(json.dumps(asdict(study.reference), sort_keys=True).encode())
    for file in filter(None, (study.reference.file, study.reference.variance)):
        digest.update(Path(expand(file)).read_bytes())
    return digest.hexdigest()


def reference_folder(study: Study, size: Size, digest: str) -> Path:
    """Folder of the batches of a study's reference that has a digest."""
    name = re.sub(r"\W+", "-", Path(study.scene).stem or "scene")
    return cache_folder("references") / f"{name}-{size[0]}x{size[1]}-{digest[:16]}"
