"""Files of arrays, complete or absent, that know what they belong to."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .errors import RenderError, one_line
from .imageio import write_atomically

Arrays = dict[str, npt.NDArray[Any]]


def make_folder(folder: Path) -> None:
    """Make a folder and its parents (RenderError where the system refuses)."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RenderError(f"cannot make {folder}: {error.strerror}") from error


def save_arrays(path: Path, label: Mapping[str, str], arrays: Mapping[str, Any]) -> None:
    """Write arrays together with their names and a label that they can be recognised by."""
    buffer = io.BytesIO()
    full = {**label, "arrays": sorted(arrays)}
    # Noise hardly compresses, and every quantity reads the frames anew.
    np.savez(buffer, label=np.array(json.dumps(full)), **arrays)
    make_folder(path.parent)
    write_atomically(path, buffer.getvalue())


def load_arrays(path: Path) -> tuple[dict[str, str], Arrays]:
    """
    Read a file's label and its arrays.

    Raises
    ------
    ValueError
        The file cannot be read or is damaged.
    """
    try:
        # From memory: np.load leaves a file open that it cannot make sense of.
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as file:
            arrays: Arrays = {name: file[name] for name in file.files}
        label: dict[str, Any] = json.loads(str(arrays.pop("label")))
        names = label.pop("arrays")
    except Exception as error:
        # Damage shows as whatever it makes zipfile, NumPy and json stumble over.
        raise ValueError(f"it cannot be read: {one_line(error) or repr(error)}") from error
    if names != sorted(arrays):
        raise ValueError(f"its arrays are {', '.join(sorted(arrays))}, not {', '.join(names)}")
    return label, arrays
