"""The picture strip: every variant as a column of frame, crops, errors and spectrum."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from PIL import Image as Pillow
from PIL import ImageDraw, ImageFont
from scipy import ndimage

from ...analysis.colours import Picture
from ...analysis.images import FloatArray, luminance
from ...imageio import to_srgb8
from ..config.study import REFERENCE
from ..measure.results import Measured
from ..runs.results import Image
from .pictures import Shown, error_pictures, seen_pictures

CROP = 32
_ZOOM = 4
_CELL = CROP * _ZOOM
_GAP = 6
_LABELS = 96
_LINE = 18
_COLUMNS = 10
_INK, _SOFT = "#1d2330", "#667085"

Place = tuple[slice, slice]
Font: TypeAlias = "ImageFont.FreeTypeFont | ImageFont.ImageFont"


def crop_of(y: FloatArray, *, smooth: bool, side: int = CROP) -> Place:
    """
    Choose a crop: rows and columns.

    Parameters
    ----------
    y : array, (H, W)
        Luminance without noise, or nearly.
    smooth : bool
        Where the image changes least, where noise is all there is to see; else where it changes
        most. Neither very dark nor very bright places are taken.
    side : int
        Its side in pixels; smaller images are taken whole.
    """
    side = min(side, *y.shape)
    calm = np.log(np.maximum(ndimage.gaussian_filter(y, 2.0), 1e-6 * max(y.max(), 1e-30)))
    dark, bright = np.log(np.maximum(np.percentile(y, [25.0, 90.0]), 1e-30))
    best, place = -np.inf, (0, 0)
    step = max(side // 4, 1)
    for row in range(0, y.shape[0] - side + 1, step):
        for column in range(0, y.shape[1] - side + 1, step):
            window = calm[row : row + side, column : column + side]
            outside = float(np.mean((window < dark) | (window > bright)))
            change = float(np.clip(window, dark, bright).std())
            score = (-change if smooth else change) - outside
            if score > best:
                best, place = score, (row, column)
    row, column = place
    return slice(row, row + side), slice(column, column + side)


@dataclass(frozen=True)
class _Row:
    """Label and pictures of a row by variant."""

    label: str
    pictures: Mapping[str, Picture]


def strip(
    data: Measured, shown: Shown, spectra: Mapping[str, Picture], captions: Mapping[str, str]
) -> Picture:
    """
    Draw the strip.

    Parameters
    ----------
    spectra : mapping of str to array, (H, W, 3)
        Spectra of the variants.
    captions : mapping of str to str
        A line under the name of each variant.

    Returns
    -------
    array, (H, W, 3), uint8
    """
    rows = _rows(data, shown, spectra)
    names = [*shown.frames, *([REFERENCE] if data.reference is not None else [])]
    bands = -(-len(names) // _COLUMNS)
    columns = -(-len(names) // bands)
    heights = [_height(row) for row in rows]
    heads = {name: _head(name, captions.get(name, "")) for name in names}
    head = _LINE * max(map(len, heads.values())) + _GAP
    band = head + sum(height + _GAP for height in heights)
    canvas = Pillow.new("RGB", (_LABELS + columns * (_CELL + _GAP), bands * band), "white")
    pen = ImageDraw.Draw(canvas)
    for index, name in enumerate(names):
        x = _LABELS + (index % columns) * (_CELL + _GAP)
        y = (index // columns) * band
        for number, (text, ink, font) in enumerate(heads[name]):
            pen.text((x, y + number * _LINE), text, fill=ink, font=font)
        y += head
        for row, height in zip(rows, heights, strict=True):
            if index % columns == 0:
                pen.multiline_text((0, y + 2), row.label, fill=_SOFT, font=_font(12), spacing=3)
            if name in row.pictures:
                canvas.paste(_scaled(row.pictures[name]), (x, y))
            y += height + _GAP
    return np.array(canvas)


def _rows(data: Measured, shown: Shown, spectra: Mapping[str, Picture]) -> list[_Row]:
    reference = data.reference
    frames = dict(shown.frames)
    if reference is not None:
        frames[REFERENCE] = reference.image.astype(np.float32)
    truth = luminance(next(iter(shown.runs.values()))[0].mean)
    truth = truth if reference is None else reference.luminance
    rows = [_Row("frame", _exposed(frames, shown.scale))]
    for label, smooth in (("detail", False), ("smooth", True)):
        crop = crop_of(truth, smooth=smooth)
        rows.append(_Row(f"{label}, 4 x", _exposed(frames, shown.scale, crop)))
        if shown.denoised:
            rows.append(_Row("denoised", _exposed(shown.denoised, shown.scale, crop)))
    if reference is not None:
        crop = crop_of(truth, smooth=True)
        near = {name: picture[crop] for name, picture in error_pictures(shown).items()}
        far = {name: picture[crop] for name, picture in seen_pictures(shown).items()}
        rows.append(_Row(f"its error,\n±{100 * shown.error_scale:.0f} %", near))
        rows.append(_Row(f"from afar,\n±{100 * shown.seen_scale:.0f} %", far))
    if spectra:
        rows.append(_Row("spectrum of\nthe error", spectra))
    return rows


def _exposed(
    frames: Mapping[str, Image], scale: float, crop: Place | None = None
) -> dict[str, Picture]:
    chosen = {name: frame if crop is None else frame[crop] for name, frame in frames.items()}
    return {name: to_srgb8(scale * frame) for name, frame in chosen.items()}


def _height(row: _Row) -> int:
    picture = next(iter(row.pictures.values()))
    return round(_CELL * picture.shape[0] / picture.shape[1])


def _scaled(picture: Picture) -> Pillow.Image:
    """Magnify crops pixel by pixel; whole frames and spectra are averaged where they shrink."""
    image = Pillow.fromarray(np.ascontiguousarray(picture))
    size = (_CELL, round(_CELL * picture.shape[0] / picture.shape[1]))
    grows = size[0] >= image.width
    return image.resize(size, Pillow.Resampling.NEAREST if grows else Pillow.Resampling.BOX)


def _head(name: str, caption: str) -> list[tuple[str, str, Font]]:
    """The lines above a column: text, colour and font."""
    name_font, caption_font = _font(13), _font(12)
    return [
        *((line, _INK, name_font) for line in wrapped(name, name_font, _CELL)),
        *((line, _SOFT, caption_font) for line in wrapped(caption, caption_font, _CELL)),
    ]


def wrapped(text: str, font: Font, width: float) -> list[str]:
    """
    Break a label into lines that are not wider than ``width`` [pixels].

    After a space or an underscore where there is one, else anywhere: names of variants are words of
    a configuration file, and none may be cut off. Joined, the lines are the text.
    """
    lines = [""]
    for piece in re.findall(r"[^ _]*[ _]|[^ _]+", text):
        if lines[-1] and font.getlength((lines[-1] + piece).rstrip()) > width:
            lines.append("")
        for letter in piece:
            if font.getlength((lines[-1] + letter).rstrip()) > width:
                lines.append("")
            lines[-1] += letter
    return [line for line in lines if line]


def _font(size: int) -> Font:
    return ImageFont.load_default(size)
