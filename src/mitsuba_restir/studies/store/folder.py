"""The folder of a study: its configuration, and one file for each finished run."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from filelock import FileLock

from ...arrays import Arrays, load_arrays, make_folder, save_arrays
from ...errors import UsageError, one_line
from ...imageio import write_atomically
from ..config.files import dump_study, load_study
from ..config.study import Size, Study
from ..runs.probing import REFERENCED
from ..runs.results import Image, Run
from ..runs.scene import scene_digest
from ..runs.software import environment
from .disk import LOCK, lock_folder
from .keys import FILE as PROVENANCE
from .keys import (
    differences,
    digest_of,
    entry,
    read_history,
    reference_digest,
    reference_folder,
    reference_key,
    remove_leftovers,
    usable_digests,
)

T = TypeVar("T")


class StudyFolder:
    """
    Reads and writes the results of one study.

    Every file is complete or absent, carries digests of the configuration and the scene that it was
    rendered with, and is refused where it cannot be read or its variant was rendered otherwise.

    At the end of its context it is given free.

    Parameters
    ----------
    path : Path
    study : Study

    Fields
    ------
    scene : str
        Digest of the scene.

    Raises
    ------
    UsageError
        The folder holds this study with other settings, or other things, or there is no such scene.
    """

    def __init__(self, path: Path, study: Study) -> None:
        self.path = path
        self.study = study
        self.digest = digest_of(study)
        self.scene = scene_digest(study)
        self.refused: list[str] = []
        rendered = study.sizes if study.reference else ()
        self._references = {z: reference_digest(study, z, self.scene) for z in rendered}
        self._lock: FileLock | None = None
        config = path / "config.toml"
        self._history = entry(study)
        try:
            known, taken = config.exists(), path.exists() and not _is_begun(path)
        except OSError as error:
            raise UsageError(f"cannot use {path}: {error.strerror}") from error
        if known:
            self._join(load_study(str(config)))
        elif taken:
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
            self._lock = lock_folder(self.path)
        for leftover in self.path.rglob(".*.partial"):
            leftover.unlink()
        remove_leftovers()
        self.write(PROVENANCE, (json.dumps(self._history, indent=1) + "\n").encode())
        self.write("config.toml", dump_study(self.study))
        if (own := environment()) not in (known := self.environments()):
            self.write("environment.json", (json.dumps([*known, own], indent=1) + "\n").encode())

    def __enter__(self) -> StudyFolder:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def release(self) -> None:
        """Give the folder free for other processes."""
        if self._lock is not None:
            self._lock.release()
            self._lock = None

    def environments(self) -> list[dict[str, str | int]]:
        """Return the machines and versions that worked on this study, first to last."""
        try:
            return list(json.loads((self.path / "environment.json").read_text("utf-8")))
        except (OSError, ValueError, TypeError):
            return []

    def _join(self, other: Study) -> None:
        """Use what another study has rendered here (UsageError where it is too different)."""
        if differing := differences(self.study, other):
            raise UsageError(
                f"{self.path} holds this study with other settings ({', '.join(differing)} "
                "differ): choose a new folder"
            )
        self._history = {**read_history(self.path), **entry(other), **self._history}

    def _label(self, path: Path) -> dict[str, str]:
        """Return what a file of this study says about itself."""
        return {"digest": self.digest, "file": self._place(path), "scene": self.scene}

    def _check(self, variant: str, path: Path, label: Mapping[str, Any]) -> None:
        """Refuse a file of a variant: what is foreign (ValueError), or of another scene."""
        digests = usable_digests(self._history, self.study, variant)
        if label["digest"] not in digests or label["file"] != self._place(path):
            raise ValueError("it belongs to another study or place")
        if label["scene"] != self.scene:
            raise UsageError(
                f"{self.path} holds this study with another content of its scene "
                f"('{self.study.scene}' or what it names has changed): choose a new folder"
            )

    def _file(self, kind: str, size: Size, variant: str, index: int, suffix: str = ".npz") -> Path:
        return self.path / kind / f"{size[0]}x{size[1]}" / variant / f"{index:04d}{suffix}"

    def load_run(self, size: Size, variant: str, index: int) -> Run | None:
        """
        Return a finished run, or None where there is none that can be trusted.

        Its single frames stay on the disk until they are asked for.
        """
        path = self._file("runs", size, variant, index)
        found = self._load(path, partial(self._check, variant, path), size)
        if found is None:
            return None
        load_frames = None if found.pop("frames", None) is None else partial(_frames, path)
        mean = found["mean"]
        session, software, remark = (
            str(found.get(name, "")) for name in ("session", "software", "remark")
        )
        return Run(
            found.get("last", mean),
            mean,
            found["times"],
            load_frames,
            session,
            software,
            found.get("stated"),
            remark,
        )

    def save_run(self, size: Size, variant: str, index: int, run: Run) -> None:
        """Write a finished run (RenderError where the disk refuses it)."""
        arrays: Arrays = {
            "mean": run.mean,
            "times": run.times,
            "session": np.array(run.session),
            "software": np.array(run.software),
        }
        if run.stated is not None:
            arrays |= {"stated": run.stated, "remark": np.array(run.remark)}
        if len(run.times) > 1:
            arrays["last"] = run.last
        if (frames := run.frames) is not None:
            arrays["frames"] = frames
        path = self._file("runs", size, variant, index)
        save_arrays(path, self._label(path), arrays)

    def load_probe(
        self, size: Size, variant: str, probe: str, index: int
    ) -> dict[str, float] | None:
        """Return what a probe said of a run, or None where it is not known."""
        path = self._file(f"probes/{probe}", size, variant, index, ".json")

        def read() -> dict[str, float]:
            content = json.loads(path.read_text("utf-8"))
            self._check(variant, path, content)
            if content.get("reference", "") != self._reference_of(probe):
                raise ValueError("it was measured with another reference")
            return {str(name): float(value) for name, value in content["numbers"].items()}

        return self._trusted(path, read)

    def save_probe(
        self, size: Size, variant: str, probe: str, index: int, numbers: Mapping[str, float]
    ) -> None:
        """Write what a probe said of a run."""
        path = self._file(f"probes/{probe}", size, variant, index, ".json")
        content = {**self._label(path), "numbers": dict(numbers)}
        if reference := self._reference_of(probe):
            content["reference"] = reference
        self.write(self._place(path), json.dumps(content).encode())

    def _reference_of(self, probe: str) -> str:
        """Return the key of the reference that a probe's answers depend on, if they do."""
        return reference_key(self.study) if probe in REFERENCED else ""

    def load_batch(self, size: Size, index: int) -> Image | None:
        """Return a finished batch of the reference, whichever study rendered it, or None."""
        path, label = self._batch(size, index)

        def check(found: Mapping[str, str]) -> None:
            if found != label:
                raise ValueError("it belongs to another reference or batch")

        found = self._load(path, check, size)
        return None if found is None else found["mean"]

    def save_batch(self, size: Size, index: int, image: Image) -> None:
        """Write a finished batch of the reference."""
        path, label = self._batch(size, index)
        save_arrays(path, label, {"mean": image})

    def _batch(self, size: Size, index: int) -> tuple[Path, dict[str, str]]:
        digest = self._references[size]
        folder = reference_folder(self.study, size, digest)
        return folder / f"{index:04d}.npz", {"digest": digest, "batch": str(index)}

    def write(self, name: str, data: bytes) -> None:
        """Write a file of results, and the folders that it is in."""
        path = self.path / name
        make_folder(path.parent)
        write_atomically(path, data)

    def _place(self, path: Path) -> str:
        return path.relative_to(self.path).as_posix()

    def _load(
        self, path: Path, check: Callable[[Mapping[str, str]], None], size: Size
    ) -> Arrays | None:
        def read() -> Arrays:
            label, arrays = load_arrays(path)
            check(label)
            if arrays["mean"].shape != (size[1], size[0], 3):
                raise ValueError("its image has another size")
            return arrays

        return self._trusted(path, read)

    def _trusted(self, path: Path, read: Callable[[], T]) -> T | None:
        """Return what a file holds; None, and a note, where it is damaged or foreign."""
        if not path.exists():
            return None
        try:
            return read()
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            self.refused.append(f"{path} is not used: {one_line(error)}")
            return None


def _frames(path: Path) -> Image:
    return load_arrays(path)[1]["frames"]


def _is_begun(path: Path) -> bool:
    """Say whether a folder without a configuration holds only what a killed process left of it."""
    return path.is_dir() and all(
        file.name in (LOCK, PROVENANCE) or file.match(".*.partial") for file in path.iterdir()
    )
