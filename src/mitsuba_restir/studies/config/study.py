"""An experiment as data: what is rendered, how often, and what is measured. Read from TOML."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import field
from typing import Any, Literal

from pydantic import model_validator
from pydantic.dataclasses import dataclass

from ...errors import UsageError
from .values import (
    CLOSED,
    REFERENCE,
    Amount,
    Batches,
    Count,
    Crop,
    Depth,
    Flag,
    FolderName,
    MitsubaVariant,
    Name,
    Natural,
    Positive,
    Share,
    Size,
    Sizes,
    Text,
    Texts,
    Value,
    VariantName,
)
from .view import Motion, View

__all__ = ["REFERENCE", "Crop", "Motion", "Reference", "Size", "Study", "Variant", "View"]


@dataclass(frozen=True, config=CLOSED)
class Variant:
    """
    One way to render the scene, or (with `of`) what is made of another variant's images.

    Fields
    ------
    type : str
        Integrator plugin, or "still": every frame is a picture of `mitsuba_restir.still`, with the
        choice of its plan.
    spp : int
        Samples (for `restir_pt`: initial candidates) per pixel and frame; a still's plan has them.
    parameters : mapping
        The plugin's parameters, or those of `still.render`; `max_depth` is the study's unless it is
        given here.
    denoise : bool
        The frame is denoised, guided by albedo and normals; a still is planned for it.
    baseline : str
        The variant that this one is compared with; empty is the study's.
    shows : str
        Type of an auxiliary image of `restir_pt` that is taken as the frame, in place of its
        colour; empty is the colour.
    of, blur_to : str
        The images of variant `of`, without their fireflies, through the Gaussian that brings their
        filtered MSE to that of variant `blur_to`. Nothing is rendered.
    """

    type: Text = ""
    spp: Count = 1
    parameters: Mapping[str, Value] = field(default_factory=dict)
    baseline: Text = ""
    shows: Text = ""
    denoise: Flag = False
    of: Text = ""
    blur_to: Text = ""

    @model_validator(mode="before")
    @classmethod
    def _of_table(cls, given: Any) -> Any:
        """Take the keys of a TOML table that are none of a variant as the plugin's parameters."""
        if not isinstance(given, Mapping):
            return given
        own, needed = ["type", "spp", "shows", "denoise", "baseline"], "type"
        if "of" in given:
            own, needed = ["of", "blur_to", "baseline"], "blur_to"
            if unknown := [key for key in given if key not in own]:
                raise ValueError(f"unknown key '{unknown[0]}'; known are {', '.join(own)}")
        if not given.get(needed):
            raise ValueError(f"'{needed}' is missing")
        parameters = {key: value for key, value in given.items() if key not in own}
        return {**{key: given[key] for key in own if key in given}, "parameters": parameters}


@dataclass(frozen=True, config=CLOSED)
class Reference:
    """
    Where the truth comes from: files, Mitsuba's `path`, or stills.

    Fields
    ------
    file, variance : str
        Image, and the variance of its values; may refer to environment variables.
    spp, batches : int
        Samples per pixel of a reference rendered here, in so many independent batches, from which
        its variance is estimated. Used where `file` is empty.
    seconds : float
        What a still takes that every batch is instead: as unbiased, and surer in the same time.
    noise : float
        Relative error of the luminance, in the median over pixels and before it is smoothed, at
        which the rendering of further batches ends; zero renders all of them.
    smooth : float
        Standard deviation in pixels of a Gaussian that smooths the reference: less noise where the
        truth is known to be smooth.
    """

    file: Text = ""
    variance: Text = ""
    spp: Natural = 0
    batches: Batches = 16
    smooth: Amount = 0.0
    noise: Amount = 0.0
    seconds: Amount = 0.0

    def __post_init__(self) -> None:
        """Check that it has one origin (ValueError)."""
        if [bool(self.file), bool(self.spp), bool(self.seconds)].count(True) != 1:
            raise ValueError("give one of file, spp and seconds")
        if self.variance and not self.file:
            raise ValueError("variance goes with file; that of spp follows from its batches")
        if self.spp % self.batches:
            raise ValueError(f"spp = {self.spp} is no multiple of the {self.batches} batches")

    @property
    def batch_spp(self) -> int:
        """Samples per pixel of a batch; zero where batches are stills."""
        return self.spp // self.batches


@dataclass(frozen=True, config=CLOSED)
class Study:
    """
    One experiment.

    Fields
    ------
    name : str
    scene : str
        Name of an embedded scene, or path of an XML file; may refer to environment variables such
        as ``$MITSUBA_RESTIR_SCENES``.
    variants : mapping of str to Variant
    sizes : sequence of (int, int)
        Width and height in pixels, of the crop where there is one; all variants are rendered at
        each.
    baseline : str
        The variant that ratios refer to; the first one by default.
    view : View or None
        None is the scene's own camera.
    crop : (float, float, float, float) or None
        Left, top, width and height of the part of the camera's image that is rendered, as shares
        of it; None is all of it.
    motion : Motion or None
        None is a camera at rest.
    max_depth : int
        Longest path in edges, for all variants and the reference; -1 is unlimited.
    frames, warmup : int
        Measured frames of a run, and frames of history rendered before them.
    stride : int
        Every so many frames one is measured: frames that are far apart err less alike.
    runs, probe_runs : int
        Independent runs, and those of every probe.
    seed : int
        All seeds follow from it: those of a frame depend on run and frame, not on the variant, so
        that variants are compared on the same random numbers where they use them alike.
    quantities : sequence of str
        What is measured; see `measure.quantities`.
    keep : str
        "last" keeps the last measured frame and the mean of all, "all" every frame too.
    reference : Reference or None
    epsilon, trim : float
        Of relMSE and of its trimmed value (share of pixels left out).
    freeze : bool
        Record the kernels of other integrators than `restir_pt` once (``dr.freeze``), so that small
        images do not measure Python overhead.
    mitsuba_variant : str
    about : str
        What the study is for and how to read it; shown in its report.
    published : mapping of str to mapping of str to float
        Values of others to be shown beside, by variant and quantity.
    """

    name: FolderName
    scene: Name
    variants: Mapping[VariantName, Variant]
    sizes: Sizes = ((320, 180),)
    baseline: Text = ""
    view: View | None = None
    crop: Crop | None = None
    motion: Motion | None = None
    max_depth: Depth = 10
    frames: Count = 1
    warmup: Natural = 0
    stride: Count = 1
    runs: Count = 2
    probe_runs: Count = 2
    seed: Natural = 0
    quantities: Texts = ("time",)
    keep: Literal["last", "all"] = "last"
    reference: Reference | None = None
    epsilon: Positive = 0.01
    trim: Share = 0.001
    freeze: Flag = True
    mitsuba_variant: MitsubaVariant = "llvm_ad_rgb"
    about: Text = ""
    published: Mapping[str, Mapping[str, Amount]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check what concerns several fields (UsageError)."""
        if not self.baseline:
            object.__setattr__(self, "baseline", next(iter(self.variants), ""))
        for problem in self._problems():
            raise UsageError(f"{self.name}: {problem}")

    def _problems(self) -> Iterator[str]:
        if not self.variants:
            yield "[variants] is empty: name at least one"
        known, rendered = ", ".join(self.variants), ", ".join(self.rendered())
        for baseline in (self.baseline, *(self.baseline_of(name) for name in self.variants)):
            if baseline not in self.variants:
                yield f"the baseline '{baseline}' is none of the variants ({known})"
        for name in self.published:
            if name not in self.variants:
                yield f"published values of '{name}', which is none of the variants ({known})"
        for name, variant in self.variants.items():
            for other in filter(None, (variant.of, variant.blur_to)):
                if other not in self.rendered():
                    some = rendered or "there are none"
                    yield f"'{name}' is made of '{other}', which is no rendered variant ({some})"
            if variant.of and self.reference is None:
                yield f"'{name}' is blurred to an error: that needs a [reference]"
        moves = self.motion is not None and not self.cuts
        if moves and self.frames > 1:
            yield (
                "a moving camera meets its reference in the last frame: frames must be 1 (and "
                "warmup the frames before)"
            )
        if self.reference and self.reference.file and len(self.sizes) > 1:
            yield f"a reference file fits one size, not {len(self.sizes)}"

    @property
    def length(self) -> int:
        """Frames of a run, those before the measured ones and between them included."""
        return self.warmup + (self.frames - 1) * self.stride + 1

    @property
    def cuts(self) -> bool:
        """Whether the camera jumps after the warm-up."""
        return self.motion is not None and self.motion.cut_from is not None

    def rendered(self) -> list[str]:
        """Names of the variants that are rendered, in order; the others are made of these."""
        return [name for name, variant in self.variants.items() if not variant.of]

    def baseline_of(self, variant: str) -> str:
        """Return the variant that a variant is compared with."""
        return self.variants[variant].baseline or self.baseline
