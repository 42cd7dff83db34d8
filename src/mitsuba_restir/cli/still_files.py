"""What a still leaves on the disk: the picture, the denoised one, and the checkpoint."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .. import __version__
from ..errors import RenderError
from ..imageio import RGB
from ..still.checkpoint import save
from ..still.growth import Growth
from ..still.picture import Still
from . import output
from .notes import say
from .writer import DENOISED

SUFFIX = ".checkpoint"
STANDARD_ERROR = "standard_error"
"""Name of the channels that hold it."""


@dataclass
class StillFiles:
    """
    Writes a still, each file complete or not at all.

    Fields
    ------
    target : Output
    label : mapping
        What a checkpoint belongs to.
    every : float or None
        Seconds between checkpoints; None writes none.
    aovs : sequence of str
        Names of the channels of auxiliary images.
    metadata : mapping
        For the header of the EXR.
    written : list of Path
        Pictures that are complete.
    kept : int
        Frames in the checkpoint; 0 while there is none.
    """

    target: output.Output
    label: Mapping[str, str]
    every: float | None
    aovs: Sequence[str]
    metadata: Mapping[str, str]
    written: list[Path] = field(default_factory=list)
    kept: int = 0
    _last: float = field(default_factory=time.perf_counter)

    @property
    def checkpoint(self) -> Path:
        """Where the checkpoint is."""
        base = self.target.name(0)
        return base.with_name(base.name + SUFFIX)

    def tick(self, growth: Growth) -> None:
        """Write a checkpoint if it is time to."""
        if self.every is not None and time.perf_counter() - self._last >= self.every:
            self.keep(growth)

    def keep(self, growth: Growth) -> None:
        """Write a checkpoint, if any are wanted; where that fails, say so and go on."""
        frames = growth.snapshot.frames
        if self.every is None or frames in (0, self.kept):
            return
        try:
            save(self.checkpoint, self.label, growth)
            self.kept = frames
        except RenderError as error:
            say(f"{error}; there is no checkpoint of these frames")
        self._last = time.perf_counter()

    def write(self, still: Still) -> None:
        """Write the picture, and the denoised one if there is one."""
        metadata = {**self.metadata, **_metadata(still)}
        names = [*RGB, *(f"{STANDARD_ERROR}.{name}" for name in RGB), *self.aovs]
        layers = [still.image, still.standard_error, *still.aovs.values()]
        image = np.concatenate(layers, axis=2)
        self.written += self.target.write(0, image, names, metadata)
        if still.denoised is not None:
            metadata["denoised"] = "Intel Open Image Denoise"
            self.written += self.target.write(0, still.denoised, RGB, metadata, DENOISED)


def _metadata(still: Still) -> dict[str, str]:
    return {
        "mitsuba-restir": __version__,
        "plan": still.plan.describe(),
        "why": still.why,
        "frames": str(still.frames),
        "seconds": f"{still.seconds:.3f}",
        "error": f"{still.error:.6g}",
        "error of all pixels": f"{still.untrimmed:.6g}",
    }
