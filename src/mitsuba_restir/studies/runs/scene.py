"""The scene of a study: its file, what it is loaded from, and the digest of all that it names."""

from __future__ import annotations

import hashlib
import inspect
import os
import pkgutil
import xml.etree.ElementTree as ElementTree
from importlib import resources
from pathlib import Path
from typing import Any

import mitsuba as mi

from ... import scenes
from ...errors import UsageError, one_line
from ..config.study import Study


def expand(path: str) -> str:
    """
    Put environment variables into a path.

    Raises
    ------
    UsageError
        One is not set.
    """
    expanded = os.path.expandvars(path)
    if "$" in expanded:
        raise UsageError(f"'{path}': set the environment variable that it refers to")
    return expanded


def scene_file(study: Study) -> Path:
    """
    Return the file of a scene that is not embedded.

    Raises
    ------
    UsageError
        There is none.
    """
    path = Path(expand(study.scene))
    if not path.is_file():
        raise UsageError(
            f"{study.name}: the scene '{path}' is neither a file nor an embedded scene "
            f"({', '.join(scenes.names())})"
        )
    return path


def load_scene(study: Study) -> Any:
    """
    Load the study's scene in the study's Mitsuba variant, which becomes the current one.

    Raises
    ------
    UsageError
        The variant, the scene or its file do not exist, or the file is broken.
    """
    try:
        mi.set_variant(study.mitsuba_variant)
    except ImportError as error:
        raise UsageError(f"{study.name}: mitsuba_variant: {one_line(error)}") from error
    if study.scene in scenes.names():
        return scenes.load(study.scene)
    path = scene_file(study)
    try:
        # Merging shapes would change which reservoirs' vertices share a shape index.
        return mi.load_file(str(path), optimize=False)
    except (RuntimeError, ValueError) as error:
        raise UsageError(f"{path} cannot be loaded: {one_line(error)}") from error


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
