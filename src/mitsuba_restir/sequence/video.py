"""Frames as a film: MP4 and WebM by PyAV (optional), animated WebP by Pillow."""

from __future__ import annotations

import importlib.util
import os
import tempfile
from collections.abc import Callable, Iterable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import RenderError, UsageError, one_line
from ..imageio import partial

Pixels = npt.NDArray[np.uint8]
"""(H, W, 3), sRGB."""

_CODECS = {
    ".mp4": ("mp4", "libx264", {"crf": "16", "preset": "medium"}),
    ".webm": ("webm", "libvpx-vp9", {"crf": "24", "b": "0", "row-mt": "1"}),
}
"""Container, encoder, and options that keep noise looking like noise."""

SUFFIXES = (*_CODECS, ".webp")


def require(suffix: str) -> None:
    """
    Make sure that a film of this kind can be written.

    Raises
    ------
    UsageError
        PyAV is not installed; says how to install it.
    """
    if suffix in _CODECS and importlib.util.find_spec("av") is None:
        raise UsageError(
            f"argument -o: {suffix} needs pip install 'mitsuba-restir[video]' (.webp does not)"
        )


def write(path: Path, frames: Iterable[Pixels], fps: float) -> None:
    """
    Write a film, complete or not at all.

    Parameters
    ----------
    path : Path
        Its suffix is one of :data:`SUFFIXES`.
    frames : iterable of arrays, (H, W, 3)
        At least one, all of one size.
    fps : float
        Frames per second.

    Raises
    ------
    RenderError
        It could not be written.
    """
    suffix = path.suffix.lower()
    encode: Callable[[str, Iterable[Pixels], float], None] = _webp
    if suffix in _CODECS:
        encode = _encoder(*_CODECS[suffix])
    try:
        handle, name = tempfile.mkstemp(**partial(path))
        os.close(handle)
        try:
            encode(name, frames, fps)
            umask = os.umask(0)
            os.umask(umask)
            os.chmod(name, 0o666 & ~umask)
            os.replace(name, path)
        finally:
            if os.path.exists(name):
                os.unlink(name)
    except (OSError, ValueError) as error:
        raise RenderError(f"cannot write {path}: {one_line(error)}") from error


def _encoder(
    container: str, codec: str, options: dict[str, str]
) -> Callable[[str, Iterable[Pixels], float], None]:
    def encode(name: str, frames: Iterable[Pixels], fps: float) -> None:
        import av

        with av.open(name, "w", format=container) as film:
            stream: Any = None
            for frame in map(_even, frames):
                if stream is None:
                    rate = Fraction(fps).limit_denominator(1001)
                    stream = film.add_stream(codec, rate=rate, options=options)
                    stream.height, stream.width = frame.shape[:2]
                    stream.pix_fmt = "yuv420p"
                    stream.codec_context.colorspace = _BT709
                    stream.codec_context.color_primaries = _BT709
                    stream.codec_context.color_trc = _BT709
                picture = av.VideoFrame.from_ndarray(frame, format="rgb24")
                picture = picture.reformat(format="yuv420p", dst_colorspace=_BT709)
                film.mux(stream.encode(picture))
            film.mux(stream.encode(None))

    return encode


_BT709 = 1
"""As FFmpeg numbers it: the colours of high definition, whose primaries are those of sRGB."""


def _even(frame: Pixels) -> Pixels:
    """With sides of even lengths, which the encoders need; an odd side repeats its last line."""
    rows, columns = (side % 2 for side in frame.shape[:2])
    return np.ascontiguousarray(np.pad(frame, ((0, rows), (0, columns), (0, 0)), mode="edge"))


def _webp(name: str, frames: Iterable[Pixels], fps: float) -> None:
    from PIL import Image

    first, *others = (Image.fromarray(frame) for frame in frames)
    first.save(
        name,
        format="WEBP",
        save_all=True,
        append_images=others,
        duration=np.diff(np.rint(np.arange(2 + len(others)) * 1000 / fps)).astype(int).tolist(),
        loop=0,
        quality=90,
        allow_mixed=False,
    )
