"""Files of arrays that are complete or absent, and know what they belong to."""

from __future__ import annotations

import io
import json
import zipfile
import zlib
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import RenderError
from ..imageio import write_atomically

Arrays = dict[str, npt.NDArray[Any]]


def make_folder(folder: Path) -> None:
    """Make a folder and its parents (RenderError where the system refuses)."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RenderError(f"cannot make {folder}: {error.strerror}") from error


def save_arrays(path: Path, label: Mapping[str, str], arrays: Mapping[str, Any]) -> None:
    """Write arrays together with the label that they can later be recognised by."""
    buffer = io.BytesIO()
    # Noise hardly compresses, and every quantity reads the frames anew.
    np.savez(buffer, label=np.array(json.dumps(label)), **arrays)
    make_folder(path.parent)
    write_atomically(path, buffer.getvalue())


def load_arrays(
    path: Path, labels: Sequence[Mapping[str, str]], leave: Collection[str] = ()
) -> tuple[Arrays, Mapping[str, tuple[int, ...]]]:
    """
    Read arrays.

    Parameters
    ----------
    labels : sequence of mapping
        What the file may say that it belongs to.
    leave : collection of str
        Names of arrays that are only checked, not kept.

    Returns
    -------
    arrays : dict of str to array
    left : mapping of str to shape
        Those that were left out.

    Raises
    ------
    ValueError
        The file cannot be read, is damaged, or has another label.
    """
    arrays: Arrays = {}
    left: dict[str, tuple[int, ...]] = {}
    try:
        # From memory: np.load leaves a file open that it cannot make sense of.
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as file:
            for name in file.files:
                array = file[name]
                if name in leave:
                    left[name] = array.shape
                else:
                    arrays[name] = array
        found = json.loads(str(arrays.pop("label")))
    except (OSError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise ValueError(str(error)) from error
    if found not in labels:
        raise ValueError("it belongs to another study or place")
    return arrays, left
