"""Where the pictures go: names, formats, and whether the place can be written."""

from __future__ import annotations

import errno
import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy.typing as npt

from .. import imageio
from ..errors import UsageError

SUFFIXES = (".exr", ".png")


@dataclass(frozen=True)
class Output:
    """
    Names of a run's files.

    Fields
    ------
    stem : Path
        Folder and name without suffix.
    png_only : bool
        No EXR beside the PNG.
    numbered : bool
        Append the frame's number, as in ``out_0000.exr``.
    """

    stem: Path
    png_only: bool
    numbered: bool

    def name(self, frame: int, extra: str = "") -> Path:
        """Return the path of a frame without its suffix; ``extra`` goes before the number."""
        number = f"_{frame:04d}" if self.numbered else ""
        return self.stem.with_name(f"{self.stem.name}{extra}{number}")

    def files(self, frame: int, extra: str = "") -> list[Path]:
        """What is written of a picture of a frame."""
        base = self.name(frame, extra)
        suffixes = SUFFIXES[1:] if self.png_only else SUFFIXES
        return [base.with_name(base.name + suffix) for suffix in suffixes]

    def write(
        self,
        frame: int,
        image: npt.ArrayLike,
        channels: Sequence[str],
        metadata: Mapping[str, str],
        extra: str = "",
    ) -> list[Path]:
        """
        Write a frame as EXR and PNG, each complete or not at all; existing files are replaced.

        Parameters
        ----------
        frame : int
            Number for the name.
        image : array_like, (H, W, C)
            Linear values.
        channels : sequence of C str
            Channel names.
        metadata : mapping
            For the header of the EXR.
        extra : str
            Part of the name that says what is special, as ``_denoised``.

        Returns
        -------
        list of Path
            The files written.
        """
        png = imageio.encode_png(image)
        contents = [png]
        if not self.png_only:
            contents = [imageio.encode_exr(image, channels, metadata), png]
        paths = self.files(frame, extra)
        for path, data in zip(paths, contents, strict=True):
            imageio.write_atomically(path, data)
        return paths

    def finish(self, frames: int | None) -> list[Path]:
        """Nothing is left to write."""
        return []


def plan(text: str | None, scene: str, numbered: bool) -> Output:
    """
    Turn ``-o`` into names. A folder gets files named after the scene.

    Parameters
    ----------
    text : str or None
        The argument; None puts the files into the current folder.
    scene : str
        The scene's name or file.
    numbered : bool
        Whether there is more than one picture.

    Raises
    ------
    UsageError
        A suffix other than .exr and .png.
    """
    default = Path(scene).stem
    if default == "scene":
        # Mitsuba scenes are usually called scene.xml, in a folder that has the name.
        default = Path(scene).resolve().parent.name or default
    path = Path(text) if text is not None else Path(default)
    if text is not None and (text.endswith(("/", os.sep)) or path.is_dir()):
        path = path / default
    suffix = path.suffix.lower()
    if suffix in SUFFIXES:
        return Output(path.with_suffix(""), suffix == ".png", numbered)
    if suffix[1:].isalpha():
        raise UsageError(
            f"argument -o: '{text}' must end in {' or '.join(SUFFIXES)}, or have no suffix"
        )
    return Output(path, False, numbered)


def prepare_folder(folder: Path, name: str = "image.exr") -> None:
    """
    Make a folder and make sure that files can be written into it.

    Parameters
    ----------
    folder : Path
    name : str
        The longest name that a file there is going to have.

    Raises
    ------
    UsageError
        It cannot be made or written, or the name is too long.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(**imageio.partial(folder / name)):
            pass
    except OSError as error:
        place = folder / name if error.errno == errno.ENAMETOOLONG else folder
        raise UsageError(f"argument -o: cannot write to {place}: {error.strerror}") from error
