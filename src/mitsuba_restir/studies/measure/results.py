"""What is measured, and what comes of it: rows of numbers, or a refusal."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from ...analysis.intervals import Interval
from ...analysis.reuse import Reuse
from ..runs.results import Image, ReferenceImage, Run


@dataclass(frozen=True)
class Sharing:
    """
    How the frames of a variant came about.

    Fields
    ------
    reuse : Reuse
        None of temporal and spatial reuse where its frames are candidates alone.
    trees : int
        Candidates per pixel and frame.
    candidates : str
        The variant that shows its candidates alone; empty where there is none.
    """

    reuse: Reuse
    trees: int
    candidates: str


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
    sharing : mapping of str to Sharing
        Of the variants that are made of candidates, by variant.
    rivals : mapping of str to sequence of str
        The variants of `path` with the same kind of frame, denoised or not, by variant.
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
    sharing: Mapping[str, Sharing] = field(default_factory=dict)
    rivals: Mapping[str, Sequence[str]] = field(default_factory=dict)

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
class Number:
    """
    One number that a quantity gives, and how it is shown.

    Fields
    ------
    name, unit : str
        In tables, CSV and figures.
    heading : str
        Of its column in the headline table; it has none where this is empty.
    better : str
        "less" or "more"; empty where neither is, and the number is a share, shown in per cent.
    yields_to : str
        Name of the number beside which it needs no column.
    chart : bool
        It has a chart of its own.
    caption : str
        Name under the pictures of a variant; of those that a study has, the last declared is shown.
    keeps_part : bool
        A part of the reference's own noise stays in it.
    keeps_all : callable or None
        Where all of that noise stays in it, what measures it.
    """

    name: str
    unit: str = ""
    heading: str = ""
    better: str = "less"
    yields_to: str = ""
    chart: bool = False
    caption: str = ""
    keeps_part: bool = False
    keeps_all: Measure | None = None


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


Measure = Callable[[Measured, Image, ReferenceImage], float]
"""Measures a frame (H, W, 3)."""

Rows = Callable[[Measured, Sequence[Number]], Iterator[Row | Refused]]
"""Measures the numbers of a quantity of every variant, or refuses to."""
