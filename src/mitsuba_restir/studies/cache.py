"""References that are rendered once for all studies: their place, and the key of their content."""

from __future__ import annotations

import hashlib
import inspect
import json
import os
import pkgutil
import re
import sys
from dataclasses import asdict
from importlib import metadata, resources
from pathlib import Path

from .. import scenes
from .config import Size, Study
from .rendering import expand

VARIABLE = "MITSUBA_RESTIR_CACHE"


def cache_folder() -> Path:
    """Return the user's cache folder of this package, or what `MITSUBA_RESTIR_CACHE` names."""
    if given := os.environ.get(VARIABLE):
        return Path(given)
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "mitsuba-restir"


def reference_digest(study: Study, size: Size) -> str:
    """Digest of everything that a batch of a reference depends on, but for its number."""
    assert study.reference is not None
    content = {
        "scene": scene_digest(study),
        "view": None if study.view is None else asdict(study.view),
        "size": list(size),
        "max_depth": study.max_depth,
        "spp": study.reference.spp // study.reference.batches,
        "variant": study.mitsuba_variant,
        "mitsuba": metadata.version("mitsuba"),
        **({} if study.crop is None else {"crop": list(study.crop)}),
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def reference_folder(study: Study, size: Size) -> Path:
    """Folder of the batches of a study's reference."""
    digest = reference_digest(study, size)
    name = re.sub(r"\W+", "-", Path(study.scene).stem or "scene")
    return cache_folder() / "references" / f"{name}-{size[0]}x{size[1]}-{digest[:16]}"


def scene_digest(study: Study) -> str:
    """Digest of a scene: of its file and all that it names, or of the code that builds it."""
    digest = hashlib.sha256()
    if study.scene in scenes.names():
        digest.update(study.scene.encode())
        for module in pkgutil.iter_modules(scenes.__path__):
            source = resources.files(scenes.__name__) / f"{module.name}.py"
            digest.update(source.read_bytes())
        digest.update(inspect.getsource(scenes).encode())
        return digest.hexdigest()
    for path in _files(Path(expand(study.scene)), set()):
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _files(path: Path, seen: set[Path]) -> list[Path]:
    """Return a scene file and, in order, every existing file that it names."""
    path = path.resolve()
    if path in seen or not path.is_file():
        return []
    seen.add(path)
    found = [path]
    if path.suffix == ".xml":
        text = path.read_text("utf-8", errors="replace")
        for name in re.findall(r'(?:value|filename)\s*=\s*"([^"$]+\.\w+)"', text):
            found += _files(path.parent / name, seen)
    return found
