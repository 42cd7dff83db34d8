"""The scope of a frame: what every step of its passes reads and none changes."""

from __future__ import annotations

from dataclasses import dataclass

import mitsuba as mi

from ..paths.grid import Grid
from ..paths.settings import PathLimits
from ..paths.spectrum import Spectra, response, wavelengths
from ..sampling.dither import Dither
from ..sampling.streams import FrameKey, PathName, Stream
from .mapping import ShiftMapping


@dataclass
class Scope:
    """Built once a stage.

    Fields: ``scene``, ``spectra`` (wavelengths; None in RGB and monochrome), ``mapping``,
    ``limits``, ``grid``, ``key`` (of the frame), ``dither`` (where the first random numbers of
    every path come from; None is the hash alone).
    """

    scene: mi.Scene
    spectra: Spectra | None
    mapping: ShiftMapping
    limits: PathLimits
    grid: Grid
    key: FrameKey
    dither: Dither | None

    def stream(self, name: PathName) -> Stream:
        """The primary samples of a path, the same for its candidate and for every replay of it."""
        if self.dither is None:
            return name.stream()
        return self.dither.stream(name, *self.grid.place(mi.UInt32(name.pixel)))

    def wavelengths(self, stream: Stream) -> tuple[mi.Spectrum, mi.Spectrum]:
        """Wavelengths [nm] of the path with this stream, and the weight of having sampled them."""
        return wavelengths(self.spectra, stream)

    def response(self, value: mi.Spectrum, lambdas: mi.Spectrum) -> mi.Color3f:
        """Sensor response (linear sRGB) to a spectral value."""
        return response(self.spectra, value, lambdas)
