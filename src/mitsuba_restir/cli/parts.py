"""A film from its parts: frames that are kept until all are there, so that a kill loses none."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

from .. import imageio
from ..errors import UsageError
from ..sequence import video
from .output import Output

MANIFEST = "animation.json"
"""What the frames beside it were rendered with."""


@dataclass(frozen=True)
class Film:
    """
    An output that is one film; takes the place of an :class:`.output.Output`.

    Fields
    ------
    path : Path
        The film.
    fps : float
        Frames per second.
    extra : str
        Which of the pictures of a frame it shows, by what their names have besides.
    """

    path: Path
    fps: float
    extra: str

    @property
    def parts(self) -> Output:
        """Names of its parts."""
        return Output(self.folder / "frame", png_only=True, numbered=True)

    @property
    def stem(self) -> Path:
        """Folder and name of its parts without suffix."""
        return self.parts.stem

    @property
    def folder(self) -> Path:
        """Where its parts are until it is whole."""
        return self.path.with_name(f"{self.path.name}.frames")

    def name(self, frame: int, extra: str = "") -> Path:
        """Path of a frame without its suffix."""
        return self.parts.name(frame, extra)

    def files(self, frame: int, extra: str = "") -> list[Path]:
        """What is written of a frame."""
        return self.parts.files(frame) if extra == self.extra else []

    def write(
        self,
        frame: int,
        image: npt.ArrayLike,
        channels: Sequence[str],
        metadata: Mapping[str, str],
        extra: str = "",
    ) -> list[Path]:
        """Keep a frame as PNG; nothing of the film is written before :meth:`finish`."""
        if extra == self.extra:
            self.parts.write(frame, image, channels, metadata)
        return []

    def finish(self, frames: int | None) -> list[Path]:
        """
        Write the film of the frames that are there, up to the first that is not.

        Parameters
        ----------
        frames : int or None
            How many there are to be; the parts go once all are in the film.
        """
        shown = list(self._shown())
        if not shown:
            return []
        video.write(self.path, map(_pixels, shown), self.fps)
        if frames is None or len(shown) >= frames:
            shutil.rmtree(self.folder)
        return [self.path]

    def _shown(self) -> Iterator[Path]:
        frame = 0
        while all(path.exists() for path in self.parts.files(frame)):
            yield from self.parts.files(frame)
            frame += 1


Target = Output | Film


def _pixels(path: Path) -> video.Pixels:
    with Image.open(path) as image:
        return np.array(image.convert("RGB"))


def begin(target: Target, settings: Mapping[str, Any], resume: bool, extras: Sequence[str]) -> int:
    """
    Note what the frames are rendered with, and find the first that is missing.

    Parameters
    ----------
    target : Output or Film
    settings : mapping
        What has to be the same if frames that are there are to stay.
    resume : bool
        Whether they are; otherwise they are replaced.
    extras : sequence of str
        What the names of a frame's pictures have besides, each.

    Returns
    -------
    int
        0 where nothing is to be resumed.

    Raises
    ------
    UsageError
        The frames that are there are of another animation; says what differs.
    """
    path = target.stem.with_name(f"{target.stem.name}_{MANIFEST}")
    frame = 0
    if resume and path.exists():
        _check_same(path, settings)
        while all(file.exists() for extra in extras for file in target.files(frame, extra)):
            frame += 1
    elif isinstance(target, Film):
        for old in target.folder.glob("frame_*.png"):
            old.unlink()
    text = json.dumps(settings, indent=1, sort_keys=True)
    imageio.write_atomically(path, text.encode())
    return frame


def _check_same(path: Path, settings: Mapping[str, Any]) -> None:
    try:
        before = json.loads(path.read_text(encoding="utf-8"))
        names = {*before, *settings}
    except (OSError, ValueError, TypeError) as error:
        raise UsageError(f"argument --resume: {path} cannot be read") from error
    for name in sorted(names):
        if before.get(name) != settings.get(name):
            raise UsageError(
                f"argument --resume: {name} is not what the frames in {path.parent} were rendered "
                f"with (see {path.name}); leave out --resume to replace them"
            )
