"""What rendering produces: runs, and the reference."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ...analysis.images import FloatArray, luminance, smoothed_reference

Image = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Run:
    """
    One finished run of one variant.

    Fields
    ------
    last, mean : array, (H, W, 3)
        Last measured frame, and the mean of all measured frames.
    times : array, (frames,)
        Seconds of each measured frame; empty where nothing was rendered.
    load_frames : callable or None
        Reads every measured frame, (frames, H, W, 3), where the study keeps all.
    session : str
        Equal for runs that took turns frame by frame, whose times can be compared.
    software : str
        Versions of what rendered it.
    stated : array, (frames, 2), or None
        The errors that stills state, without the worst pixels and with them.
    remark : str
        What the renderer says of its last frame; often nothing.
    """

    last: Image
    mean: Image
    times: npt.NDArray[np.float64]
    load_frames: Callable[[], Image] | None = None
    session: str = ""
    software: str = ""
    stated: npt.NDArray[np.float64] | None = None
    remark: str = ""

    @property
    def frames(self) -> Image | None:
        """Every measured frame, (frames, H, W, 3), read anew: they are large."""
        return None if self.load_frames is None else self.load_frames()


@dataclass(frozen=True)
class ReferenceImage:
    """
    The truth and how sure it is.

    Fields
    ------
    image, variance : array, (H, W, 3)
        Mean, and variance of the mean (zero where unknown).
    smooth : float
        Standard deviation in pixels of the Gaussian that both have been smoothed by.
    sharp : ReferenceImage or None
        What was smoothed. Its pixels err independently, as sums over pixels have to know.
    samples : int
        Samples per pixel that it was rendered from; zero where that is not known.
    """

    image: npt.NDArray[np.float64]
    variance: npt.NDArray[np.float64]
    smooth: float = 0.0
    sharp: ReferenceImage | None = None
    samples: int = 0

    @property
    def unsmoothed(self) -> ReferenceImage:
        """The reference before it was smoothed."""
        return self.sharp or self

    @cached_property
    def luminance(self) -> FloatArray:
        """Luminance of the image, (H, W)."""
        return luminance(self.image)

    @cached_property
    def scale(self) -> FloatArray:
        """What relative errors are divided by, (H, W): the smoothed luminance."""
        return smoothed_reference(self.luminance)

    @cached_property
    def luminance_variance(self) -> FloatArray:
        """Variance of the luminance, (H, W), as if the channels erred as one (they nearly do)."""
        return luminance(np.sqrt(self.variance)) ** 2

    @property
    def noise(self) -> float:
        """Relative error of its luminance, in the median over the pixels that are not black."""
        lit = self.luminance > 0.0
        if not lit.any():
            return 0.0
        return float(np.median(np.sqrt(self.luminance_variance[lit]) / self.luminance[lit]))
