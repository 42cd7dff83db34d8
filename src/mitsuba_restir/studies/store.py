"""The folder of a study: its configuration, and one file for each finished run."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import RenderError, UsageError, one_line
from ..imageio import write_atomically
from .config import Size, Study
from .environment import environment
from .files import dump_study, load_study
from .lock import FILE as LOCK
from .lock import FolderLock
from .results import Image, Run
from .tables import to_table

# These decide how much is rendered or what is measured, not what a finished run looks like.
_FREE_KEYS = frozenset({"runs", "probe_runs", "quantities", "baseline", "epsilon", "trim"})


class StudyFolder:
    """
    Reads and writes the results of one study.

    Every file is complete or absent, carries a digest of the configuration that it was rendered
    with, and is refused where it cannot be read or the digest is another one.

    Parameters
    ----------
    path : Path
    study : Study

    Raises
    ------
    UsageError
        The folder holds another study, or other things.
    """

    def __init__(self, path: Path, study: Study) -> None:
        self.path = path
        self.study = study
        self.digest = _digest(_rendering(study))
        self.refused: list[str] = []
        self._lock: FolderLock | None = None
        config = path / "config.toml"
        if config.exists():
            self._compare(load_study(str(config)))
        elif path.exists() and (not path.is_dir() or any(f.name != LOCK for f in path.iterdir())):
            raise UsageError(f"{path} exists and holds no study: choose a new folder")

    def claim(self) -> None:
        """
        Make and lock the folder and write what is run, once it is known that it can be run.

        Raises
        ------
        UsageError
            The folder cannot be made, or another process works in it.
        RenderError
            It cannot be written to.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UsageError(f"cannot make {self.path}: {error.strerror}") from error
        if self._lock is None:
            self._lock = FolderLock(self.path)
        for leftover in self.path.rglob(".*.partial"):
            leftover.unlink()
        write_atomically(self.path / "config.toml", dump_study(self.study))
        self._note_environment()

    def release(self) -> None:
        """Give the folder free for other processes."""
        if self._lock is not None:
            self._lock.release()
            self._lock = None

    def environments(self) -> list[dict[str, str | int]]:
        """Return the machines and versions that worked on this study, first to last."""
        try:
            found: list[dict[str, str | int]] = json.loads(
                (self.path / "environment.json").read_text("utf-8")
            )
        except (OSError, ValueError):
            return []
        return found

    def _note_environment(self) -> None:
        known, own = self.environments(), environment()
        if own not in known:
            self.write("environment.json", (json.dumps([*known, own], indent=1) + "\n").encode())

    def _compare(self, other: Study) -> None:
        mine, theirs = _rendering(self.study), _rendering(other)
        differing = sorted(k for k in mine.keys() | theirs.keys() if mine.get(k) != theirs.get(k))
        if differing:
            raise UsageError(
                f"{self.path} holds this study with other settings ({', '.join(differing)} "
                "differ): choose a new folder"
            )

    def _file(self, kind: str, size: Size, variant: str, index: int) -> Path:
        return self.path / kind / f"{size[0]}x{size[1]}" / variant / f"{index:04d}.npz"

    def load_run(self, size: Size, variant: str, index: int) -> Run | None:
        """Return a finished run, or None where there is none that can be trusted."""
        arrays = self._load(self._file("runs", size, variant, index), size)
        if arrays is None:
            return None
        mean = arrays["mean"]
        return Run(arrays.get("last", mean), mean, arrays["times"], arrays.get("frames"))

    def save_run(self, size: Size, variant: str, index: int, run: Run) -> None:
        """Write a finished run (RenderError where the disk refuses it)."""
        arrays: dict[str, npt.NDArray[Any]] = {"mean": run.mean, "times": run.times}
        if len(run.times) > 1:
            arrays["last"] = run.last
        if run.frames is not None:
            arrays["frames"] = run.frames
        self._save(self._file("runs", size, variant, index), arrays)

    def load_probe(
        self, size: Size, variant: str, probe: str, index: int
    ) -> dict[str, float] | None:
        """Return what a probe said of a run, or None where it is not known."""
        path = self._probe_file(size, variant, probe, index)
        if not path.exists():
            return None
        try:
            content = json.loads(path.read_text("utf-8"))
            if content["digest"] != self.digest or content["file"] != self._label(path):
                raise ValueError("it belongs to another study or place")
            return {str(name): float(value) for name, value in content["numbers"].items()}
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            self.refused.append(f"{path} is not used: {one_line(error)}")
            return None

    def save_probe(
        self, size: Size, variant: str, probe: str, index: int, numbers: Mapping[str, float]
    ) -> None:
        """Write what a probe said of a run."""
        path = self._probe_file(size, variant, probe, index)
        content = {"digest": self.digest, "file": self._label(path), "numbers": dict(numbers)}
        _make(path.parent)
        write_atomically(path, json.dumps(content).encode())

    def _probe_file(self, size: Size, variant: str, probe: str, index: int) -> Path:
        return self._file(f"probes/{probe}", size, variant, index).with_suffix(".json")

    def load_batch(self, size: Size, index: int) -> Image | None:
        """Return a finished batch of the reference, or None."""
        arrays = self._load(self._file("reference", size, "path", index), size)
        return None if arrays is None else arrays["mean"]

    def save_batch(self, size: Size, index: int, image: Image) -> None:
        """Write a finished batch of the reference."""
        self._save(self._file("reference", size, "path", index), {"mean": image})

    def write(self, name: str, data: bytes) -> None:
        """Write a file of results."""
        write_atomically(self.path / name, data)

    def _save(self, path: Path, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        buffer = io.BytesIO()
        label = json.dumps({"digest": self.digest, "file": self._label(path)})
        np.savez_compressed(buffer, label=np.array(label), **arrays)  # type: ignore[arg-type]
        _make(path.parent)
        write_atomically(path, buffer.getvalue())

    def _label(self, path: Path) -> str:
        return path.relative_to(self.path).as_posix()

    def _load(self, path: Path, size: Size) -> dict[str, npt.NDArray[Any]] | None:
        if not path.exists():
            return None
        try:
            # From memory: np.load leaves a file open that it cannot make sense of.
            with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as file:
                arrays = {name: file[name] for name in file.files}
            label = json.loads(str(arrays.pop("label")))
            if label != {"digest": self.digest, "file": self._label(path)}:
                raise ValueError("it belongs to another study or place")
            if arrays["mean"].shape != (size[1], size[0], 3):
                raise ValueError("its image has another size")
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as error:
            self.refused.append(f"{path} is not used: {one_line(error)}")
            return None
        return arrays


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RenderError(f"cannot make {folder}: {error.strerror}") from error


def _rendering(study: Study) -> dict[str, Any]:
    table = {key: value for key, value in to_table(study).items() if key not in _FREE_KEYS}
    for variant in table["variants"].values():
        variant.pop("baseline", None)
    if reference := table.get("reference"):
        reference = table["reference"] = dict(reference)
        del reference["smooth"]
    return table


def _digest(table: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(table, sort_keys=True).encode()).hexdigest()
