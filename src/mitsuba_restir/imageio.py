"""Images in and out: EXR with named channels, PNG; a file is either complete or not there."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import numpy.typing as npt

from .errors import RenderError, UsageError, one_line

Image = npt.NDArray[np.float32]
RGB = ("R", "G", "B")


def with_rgb(image: npt.ArrayLike, extra: int) -> Image:
    """
    Return an image whose first channels are red, green and blue, also in mono variants.

    Parameters
    ----------
    image : array_like, (H, W, 1 + extra) or (H, W, 3 + extra)
        As rendered.
    extra : int
        Number of channels after the colour.
    """
    pixels = np.asarray(image, dtype=np.float32)
    if pixels.shape[2] == 1 + extra:
        return np.concatenate([pixels[..., :1]] * 2 + [pixels], axis=2)
    return pixels


def partial(path: Path) -> dict[str, Any]:
    """Where ``tempfile`` shall put what becomes a file, so that a kill leaves nothing half done."""
    return {"prefix": f".{path.name}.", "suffix": ".partial", "dir": path.parent}


def write_atomically(path: Path, data: bytes) -> None:
    """
    Write a file under a temporary name beside its place, then rename it.

    Raises
    ------
    RenderError
        The file could not be written (a full disk, a missing folder); what was there before is
        untouched.
    """
    try:
        handle, name = tempfile.mkstemp(**partial(path))
    except OSError as error:
        raise RenderError(f"cannot write {path}: {error.strerror}") from error
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        # mkstemp makes private files; give this one the permissions of any other new file.
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(name, 0o666 & ~umask)
        os.replace(name, path)
    except OSError as error:
        raise RenderError(f"cannot write {path}: {error.strerror}") from error
    finally:
        if os.path.exists(name):
            os.unlink(name)


def encode_exr(
    image: npt.ArrayLike,
    channels: Sequence[str] = RGB,
    metadata: Mapping[str, str] | None = None,
    half: bool = False,
) -> bytes:
    """
    Encode an image as OpenEXR.

    Parameters
    ----------
    image : array_like, (H, W, C)
        Linear values.
    channels : sequence of C str
        Channel names, ``R, G, B`` first; layers as in ``albedo.R``.
    metadata : mapping of str to str, optional
        Written into the header.
    half : bool
        Store 16-bit floats instead of 32-bit ones.
    """
    pixels = np.ascontiguousarray(image, dtype=np.float32)
    if pixels.ndim != 3 or pixels.shape[2] != len(channels):
        raise ValueError(f"An image of shape {pixels.shape} cannot have channels {channels}.")
    if tuple(channels) == RGB:
        bitmap = mi.Bitmap(pixels, pixel_format=mi.Bitmap.PixelFormat.RGB)
    else:
        bitmap = mi.Bitmap(pixels, channel_names=list(channels))
    if half:
        kind = mi.Struct.Type.Float16
        bitmap = bitmap.convert(component_format=kind, srgb_gamma=False)
    for name, text in (metadata or {}).items():
        bitmap.metadata()[name] = text
    return _encode(bitmap, mi.Bitmap.FileFormat.OpenEXR)


def to_srgb8(image: npt.ArrayLike) -> npt.NDArray[np.uint8]:
    """
    Convert linear colour to 8-bit sRGB; what is not finite becomes black.

    Parameters
    ----------
    image : array_like, (H, W, C)
        Linear values; the first three channels are red, green and blue.
    """
    colour = np.asarray(image, dtype=np.float32)[..., :3]
    colour = np.where(np.isfinite(colour), colour, np.float32(0.0))
    bitmap = mi.Bitmap(np.ascontiguousarray(colour), pixel_format=mi.Bitmap.PixelFormat.RGB)
    return np.array(bitmap.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.UInt8, True))


def encode_png(image: npt.ArrayLike) -> bytes:
    """Encode linear colour (H, W, C), or 8-bit sRGB as it is, as PNG."""
    pixels = np.asarray(image)
    if pixels.dtype != np.uint8:
        pixels = to_srgb8(pixels)
    return _encode(mi.Bitmap(np.ascontiguousarray(pixels)), mi.Bitmap.FileFormat.PNG)


def _encode(bitmap: mi.Bitmap, kind: mi.Bitmap.FileFormat) -> bytes:
    stream = mi.MemoryStream()
    bitmap.write(stream, kind)
    return bytes(stream.raw_buffer())


def read_rgb(path: Path) -> Image:
    """
    Read the colour of an image file.

    Returns
    -------
    array, (H, W, 3)
        Linear values.

    Raises
    ------
    UsageError
        The file is missing or is no image.
    """
    if not path.is_file():
        raise UsageError(f"{path} is not a file")
    try:
        bitmap = mi.Bitmap(str(path))
        names = [field.name for field in bitmap.struct_()]
        if len(names) > 3 and set(RGB) <= set(names):
            values = np.array(bitmap, dtype=np.float32)[..., [names.index(name) for name in RGB]]
            return np.ascontiguousarray(values)
        rgb = bitmap.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False)
    except RuntimeError as error:
        raise UsageError(f"cannot read {path}: {one_line(error)}") from error
    return np.array(rgb)
