"""The scene of a study: its file, and the digest of all that it names."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import mitsuba as mi

from ... import scenes
from ...errors import UsageError, one_line
from ...scene_files import digest
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
    return digest(study.scene if study.scene in scenes.names() else str(scene_file(study)))
