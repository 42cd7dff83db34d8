"""What a study has produced: runs, the reference, and rows of numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ..analysis.images import FloatArray, luminance, smoothed_reference
from ..analysis.intervals import Interval

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
    """

    last: Image
    mean: Image
    times: npt.NDArray[np.float64]
    load_frames: Callable[[], Image] | None = None
    session: str = ""
    software: str = ""

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


@dataclass(frozen=True)
class Measured:
    """
    All that a quantity is measured from, at one size.

    Fields
    ------
    size : str
        As in "320x180".
    runs : mapping of str to sequence of Run
        The finished runs of each variant, in order.
    baseline : str
        The study's baseline.
    baselines : mapping of str to str
        The variant that a variant is compared with (itself for a baseline).
    reference : ReferenceImage or None
    epsilon, trim : float
        Of relMSE and its trimmed value.
    probes : mapping of (str, str) to sequence of mapping
        What a probe said of each run of a variant, by variant and probe.
    settled : bool
        The measured frames of a run come after a warm-up and are alike.
    blurs : mapping of str to float
        Standard deviation in pixels of the Gaussian of each variant that is made by one.
    notes : sequence of str
        What cannot be given, and why.
    """

    size: str
    runs: Mapping[str, Sequence[Run]]
    baseline: str
    baselines: Mapping[str, str]
    reference: ReferenceImage | None
    epsilon: float
    trim: float
    probes: Mapping[tuple[str, str], Sequence[Mapping[str, float]]] = field(default_factory=dict)
    settled: bool = False
    blurs: Mapping[str, float] = field(default_factory=dict)
    notes: Sequence[str] = ()

    def partner(self, variant: str) -> str | None:
        """Return the variant that one is compared with run by run; None where that cannot be."""
        other = self.baselines.get(variant, self.baseline)
        paired = len(self.runs[variant]) == len(self.runs.get(other, ())) > 1
        return other if other != variant and paired else None

    @property
    def variants(self) -> list[str]:
        """Names of all variants, in order."""
        return list(self.runs)

    @property
    def pixels(self) -> int:
        """Pixels of an image."""
        width, height = self.size.split("x")
        return int(width) * int(height)

    def probed(self, variant: str, probe: str) -> Sequence[Mapping[str, float]]:
        """Return what a probe said of each run of a variant."""
        return self.probes.get((variant, probe), ())


@dataclass(frozen=True)
class Refused:
    """
    What was asked for and cannot be given.

    Fields
    ------
    reason : str
        One sentence: what, why, and what to do.
    """

    reason: str


@dataclass(frozen=True)
class Row:
    """
    One number of one variant.

    Fields
    ------
    size, variant, quantity, unit : str
    value : Interval
        Its interval is NaN where a single run allows none.
    ratio : Interval or None
        Ratio to the baseline; None for the baseline itself or where it is not defined.
    runs : int
        Independent runs behind the value.
    p_value : float or None
        Of a paired test against the baseline; None where there is none.
    """

    size: str
    variant: str
    quantity: str
    unit: str
    value: Interval
    ratio: Interval | None
    runs: int
    p_value: float | None = None
