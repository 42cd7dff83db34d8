"""From rendered frames to files: selects channels, averages, denoises."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..analysis.denoise import GUIDES, denoise_guided
from ..imageio import RGB, Image
from .parts import Target

DENOISED = "_denoised"
"""What the names of denoised pictures have besides."""


@dataclass
class Writer:
    """
    Turns rendered frames into files: selects channels, averages, denoises.

    Fields
    ------
    target : Output or Film
    channels : sequence of str
        Names of the rendered channels.
    kept : sequence of str
        Names of those that are written.
    guides : mapping
        AOV type to AOV name, of what the denoiser needs; empty without denoising.
    average : bool
        Keep a running sum instead of writing each frame.
    metadata : mapping
        For the header of each EXR.
    written : list of Path
        Files that are complete.
    sum : (array, int)
        Sum of the frames to be averaged, (H, W, C), and how many frames there were.
    """

    target: Target
    channels: Sequence[str]
    kept: Sequence[str]
    guides: Mapping[str, str]
    average: bool
    metadata: Mapping[str, str]
    written: list[Path] = field(default_factory=list)
    sum: tuple[npt.NDArray[np.float64], int] = (np.zeros(()), 0)

    @property
    def frames(self) -> int:
        """How many frames it has taken."""
        return self.sum[1]

    def add(self, frame: int, image: Image) -> None:
        """Take one frame."""
        total, count = self.sum
        if self.average:
            total = total + image
        else:
            self._write(frame, image, {"frame": str(frame)})
        # Both at once: a signal may end the command here.
        self.sum = total, count + 1

    def finish(self, frames: int | None) -> None:
        """Write what can be written only at the end: the average, or the film of so many frames."""
        total, count = self.sum
        if self.average and count:
            mean = (total / count).astype(np.float32)
            self._write(0, mean, {"frames averaged": str(count)})
        self.written += self.target.finish(frames)

    def _select(self, image: Image, names: Sequence[str]) -> Image:
        return image[..., [self.channels.index(name) for name in names]]

    def _layer(self, image: Image, name: str) -> Image:
        names = [channel for channel in self.channels if channel.startswith(f"{name}.")]
        return self._select(image, names)

    def _write(self, frame: int, image: Image, more: Mapping[str, str]) -> None:
        metadata = {**self.metadata, **more}
        kept = self._select(image, self.kept)
        self.written += self.target.write(frame, kept, self.kept, metadata)
        if self.guides:
            layers = [self._layer(image, self.guides[kind]) for kind in GUIDES]
            clean = denoise_guided(self._select(image, RGB), *layers)
            metadata["denoised"] = "Intel Open Image Denoise"
            self.written += self.target.write(frame, clean, RGB, metadata, DENOISED)
