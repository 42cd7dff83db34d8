"""What a scene is made of: the digest of its file and all that it names, or of the code."""

from __future__ import annotations

import hashlib
import inspect
import os
import pkgutil
import xml.etree.ElementTree as ElementTree
from importlib import resources
from pathlib import Path

from . import scenes
from .errors import UsageError


def digest(source: str) -> str:
    """
    Digest of a scene: of its file and all that it names, or of the code that builds it.

    Parameters
    ----------
    source : str
        Name of an embedded scene, or path of a file.

    Raises
    ------
    UsageError
        One of its files cannot be read.
    """
    found = hashlib.sha256()
    if source in scenes.names():
        found.update(source.encode())
        for module in pkgutil.iter_modules(scenes.__path__):
            text = resources.files(scenes.__name__) / f"{module.name}.py"
            found.update(text.read_bytes())
        found.update(inspect.getsource(scenes).encode())
        return found.hexdigest()
    try:
        for path in _files(Path(source)):
            found.update(path.name.encode())
            found.update(path.read_bytes())
    except OSError as error:
        raise UsageError(f"{source}: cannot read {error.filename}: {error.strerror}") from error
    return found.hexdigest()


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
