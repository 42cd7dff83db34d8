"""References that are rendered once for all studies: their place, and the key of their content."""

from __future__ import annotations

import hashlib
import inspect
import json
import os
import pkgutil
import re
import sys
import time
import xml.etree.ElementTree as ElementTree
from contextlib import suppress
from dataclasses import asdict
from importlib import metadata, resources
from pathlib import Path

from ... import scenes
from ...errors import UsageError
from ..config.study import Size, Study
from ..runs.rendering import expand, scene_file

VARIABLE = "MITSUBA_RESTIR_CACHE"

# Seconds; writing a batch takes less than one.
_LEFT_AFTER = 3600.0


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


def remove_leftovers() -> None:
    """Remove what processes that were killed have left half written in the cache."""
    for file in (cache_folder() / "references").rglob(".*.partial"):
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
    return cache_folder() / "references" / f"{name}-{size[0]}x{size[1]}-{digest[:16]}"


def scene_digest(study: Study) -> str:
    """
    Digest of a scene: of its file and all that it names, or of the code that builds it.

    Raises
    ------
    UsageError
        There is no such scene, or one of its files cannot be read.
    """
    digest = hashlib.sha256()
    if study.scene in scenes.names():
        digest.update(study.scene.encode())
        for module in pkgutil.iter_modules(scenes.__path__):
            source = resources.files(scenes.__name__) / f"{module.name}.py"
            digest.update(source.read_bytes())
        digest.update(inspect.getsource(scenes).encode())
        return digest.hexdigest()
    scene = scene_file(study)
    try:
        for path in _files(scene):
            digest.update(path.name.encode())
            digest.update(path.read_bytes())
    except OSError as error:
        raise UsageError(f"{scene}: cannot read {error.filename}: {error.strerror}") from error
    return digest.hexdigest()


def _files(scene: Path) -> list[Path]:
    """Return a scene file and, in order, every existing file that it may mean by a name."""
    folders = [scene.parent]
    # As a set that keeps its order.
    found: dict[Path, None] = {}

    def add(path: Path) -> None:
        path = path.resolve()
        if path in found:
            return
        found[path] = None
        for node in _nodes(path):
            names = [text for key, text in node.attrib.items() if key in ("value", "filename")]
            if node.tag == "path":
                folders.extend(path.parent / name for name in names)
            for place in [folder / name for name in names for folder in (path.parent, *folders)]:
                # Unlike Path.is_file, it knows that a long list of numbers is no name.
                if os.path.isfile(place):
                    add(place)

    add(scene)
    return list(found)


def _nodes(path: Path) -> list[ElementTree.Element]:
    """Return the elements of an XML file; none where it is not one, which loading it will say."""
    if path.suffix != ".xml":
        return []
    try:
        return list(ElementTree.parse(path).getroot().iter())
    except (ElementTree.ParseError, ValueError):
        return []
