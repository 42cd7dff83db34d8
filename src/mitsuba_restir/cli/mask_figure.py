"""The picture of ``mitsuba-restir mask``: masks and their spectra, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from PIL import Image as Pillow
from PIL import ImageDraw, ImageFont

from ..sampling.void_cluster import Ranks

_SIDE = 512  # of a panel, in pixels
_CROP = 128  # pixels of a mask that a panel shows: more cannot be told apart by eye
_MARGIN = 10
_LABEL = 46
_LOWEST, _HIGHEST = 1e-4, 10.0  # power shown as black and as white; white noise is 1

Grey = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Panel:
    """
    A mask of the figure.

    Fields
    ------
    name : str
    ranks : array, (n, n)
    spectrum : array, (n, n)
        Power relative to white noise, in the order of `np.fft.fft2`.
    """

    name: str
    ranks: Ranks
    spectrum: npt.NDArray[np.float64]


def mask_grey(ranks: Ranks) -> Grey:
    """Show ranks as 8-bit grey, every level equally often."""
    return (ranks.astype(np.uint64) * 256 // ranks.size).astype(np.uint8)


def spectrum_grey(spectrum: npt.NDArray[np.float64]) -> Grey:
    """Show a spectrum as 8-bit grey on a logarithmic scale, frequency 0 in the centre."""
    centred = np.fft.fftshift(spectrum)
    exponent = np.log10(np.clip(centred, _LOWEST, _HIGHEST) / _LOWEST)
    return np.rint(255.0 * exponent / np.log10(_HIGHEST / _LOWEST)).astype(np.uint8)


def draw(panels: Sequence[Panel]) -> Grey:
    """
    Draw each mask (a crop, magnified) with its spectrum to the right.

    Returns
    -------
    array, (H, W, 3), uint8
    """
    cell = _SIDE + _MARGIN
    size = (2 * len(panels) * cell + _MARGIN, _SIDE + _LABEL + 2 * _MARGIN)
    canvas = Pillow.new("RGB", size, "white")
    pen = ImageDraw.Draw(canvas)
    font = ImageFont.load_default(16)
    for index, panel in enumerate(panels):
        n = len(panel.ranks)
        crop = min(n, _CROP)
        name = panel.name.replace("_", "-")
        cells = (
            (
                mask_grey(panel.ranks)[:crop, :crop],
                f"{name} mask, {n} x {n} pixels\n({crop} x {crop} of them)",
            ),
            (
                spectrum_grey(panel.spectrum),
                f"its power spectrum, to 0.5 cycles/pixel\n{_LOWEST:g} (black) to {_HIGHEST:g} "
                "(white) x white noise",
            ),
        )
        for column, (grey, label) in enumerate(cells):
            x = _MARGIN + (2 * index + column) * cell
            pen.text((x, _MARGIN), label, fill="black", font=font, spacing=2)
            # Averaging would turn the speckle of a large spectrum into its mean.
            picture = Pillow.fromarray(grey).resize((_SIDE, _SIDE), Pillow.Resampling.NEAREST)
            canvas.paste(picture, (x, _MARGIN + _LABEL))
    return np.array(canvas)
