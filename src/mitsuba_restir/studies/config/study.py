"""An experiment as data: what is rendered, how often, and what is measured. Read from TOML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ...errors import UsageError
from ..measure.quantities import QUANTITIES, unknown_quantity

REFERENCE = "reference"
"""What the truth is called beside the variants."""

Vector = tuple[float, float, float]
Crop = tuple[float, float, float, float]
Size = tuple[int, int]
Value = bool | int | float | str


@dataclass(frozen=True)
class View:
    """
    A perspective camera in place of the scene's own.

    Fields
    ------
    fov : float
        Horizontal field of view in degrees.
    origin, target, up : (float, float, float)
        As in Mitsuba's ``look_at``.
    """

    fov: float
    origin: Vector
    target: Vector
    up: Vector = (0.0, 1.0, 0.0)


@dataclass(frozen=True)
class Motion:
    """
    What moves evenly and arrives with the last frame of a run, where the reference is.

    Fields
    ------
    step : (float, float, float)
        Of the camera, in world units per frame; it arrives at the study's view.
    light : str
        A parameter of the scene that is a transform, as in "light.to_world" of a rectangle that
        shines. What it moves arrives where the scene has it.
    light_step : (float, float, float)
        Its step in world units per frame.
    """

    step: Vector = (0.0, 0.0, 0.0)
    light: str = ""
    light_step: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Variant:
    """
    One way to render the scene, or (with `of`) what is made of another variant's images.

    Fields
    ------
    type : str
        Integrator plugin.
    spp : int
        Samples (for `restir_pt`: initial candidates) per pixel and frame.
    parameters : mapping
        The plugin's parameters; `max_depth` is the study's unless it is given here.
    baseline : str
        The variant that this one is compared with; empty is the study's.
    shows : str
        Type of an auxiliary image of `restir_pt` that is taken as the frame, in place of its
        colour; empty is the colour.
    of, blur_to : str
        The images of variant `of`, without their fireflies, through the Gaussian that brings their
        filtered MSE to that of variant `blur_to`. Nothing is rendered.
    """

    type: str = ""
    spp: int = 1
    parameters: Mapping[str, Value] = field(default_factory=dict)
    baseline: str = ""
    shows: str = ""
    of: str = ""
    blur_to: str = ""


@dataclass(frozen=True)
class Reference:
    """
    Where the truth comes from: files, or Mitsuba's `path`.

    Fields
    ------
    file, variance : str
        Image, and the variance of its values; may refer to environment variables.
    spp, batches : int
        Samples per pixel of a reference rendered here, in so many independent batches, from which
        its variance is estimated. Used where `file` is empty.
    noise : float
        Relative error of the luminance, in the median over pixels and before it is smoothed, at
        which the rendering of further batches ends; zero renders all of them.
    smooth : float
        Standard deviation in pixels of a Gaussian that smooths the reference: less noise where the
        truth is known to be smooth.
    """

    file: str = ""
    variance: str = ""
    spp: int = 0
    batches: int = 16
    smooth: float = 0.0
    noise: float = 0.0


@dataclass(frozen=True)
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
        Independent runs, and those of every probe (see `probes.PROBES`).
    seed : int
        All seeds follow from it: those of a frame depend on run and frame, not on the variant, so
        that variants are compared on the same random numbers where they use them alike.
    quantities : sequence of str
        What is measured; see `quantities.QUANTITIES`.
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

    name: str
    scene: str
    variants: Mapping[str, Variant]
    sizes: Sequence[Size] = ((320, 180),)
    baseline: str = ""
    view: View | None = None
    crop: Crop | None = None
    motion: Motion | None = None
    max_depth: int = 10
    frames: int = 1
    warmup: int = 0
    stride: int = 1
    runs: int = 2
    probe_runs: int = 2
    seed: int = 0
    quantities: Sequence[str] = ("time",)
    keep: str = "last"
    reference: Reference | None = None
    epsilon: float = 0.01
    trim: float = 0.001
    freeze: bool = True
    mitsuba_variant: str = "llvm_ad_rgb"
    about: str = ""
    published: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check what concerns several fields (UsageError)."""
        if not self.baseline:
            object.__setattr__(self, "baseline", next(iter(self.variants), ""))
        for baseline in (self.baseline, *(self.baseline_of(name) for name in self.variants)):
            if baseline not in self.variants:
                raise UsageError(
                    f"{self.name}: the baseline '{baseline}' is none of the variants "
                    f"({', '.join(self.variants) or 'there are none'})"
                )
        unknown = [name for name in self.quantities if name not in QUANTITIES]
        if unknown:
            raise UsageError(f"{self.name}: {unknown_quantity(unknown[0])}")
        for name in self.quantities:
            self._check_quantity(name)
        strange = [name for name in self.published if name not in self.variants]
        if strange:
            raise UsageError(
                f"{self.name}: published values of '{strange[0]}', which is none of the variants "
                f"({', '.join(self.variants)})"
            )
        for name, variant in self.variants.items():
            for other in filter(None, (variant.of, variant.blur_to)):
                if other not in self.rendered():
                    raise UsageError(
                        f"{self.name}: '{name}' is made of '{other}', which is no rendered variant "
                        f"({', '.join(self.rendered()) or 'there are none'})"
                    )
            if variant.of and self.reference is None:
                raise UsageError(
                    f"{self.name}: '{name}' is blurred to an error: that needs a [reference]"
                )
        if self.motion is not None and self.frames > 1:
            raise UsageError(
                f"{self.name}: a moving camera meets its reference in the last frame: frames must "
                "be 1 (and warmup the frames before)"
            )
        if self.reference and self.reference.file and len(self.sizes) > 1:
            raise UsageError(f"{self.name}: a reference file fits one size, not {len(self.sizes)}")

    @property
    def length(self) -> int:
        """Frames of a run, those before the measured ones and between them included."""
        return self.warmup + (self.frames - 1) * self.stride + 1

    def rendered(self) -> list[str]:
        """Names of the variants that are rendered, in order; the others are made of these."""
        return [name for name, variant in self.variants.items() if not variant.of]

    def baseline_of(self, variant: str) -> str:
        """Return the variant that a variant is compared with."""
        return self.variants[variant].baseline or self.baseline

    def probes(self) -> list[str]:
        """Return the probes that the quantities need."""
        found = (QUANTITIES[name].probe for name in self.quantities)
        return list(dict.fromkeys(probe for probe in found if probe))

    def shows_images(self) -> bool:
        """Return whether any quantity is measured from images or times of frames."""
        return any(not QUANTITIES[name].probe for name in self.quantities)

    def _check_quantity(self, name: str) -> None:
        needs = QUANTITIES[name]
        if needs.needs_reference and self.reference is None:
            raise UsageError(f"{self.name}: '{name}' needs a [reference] with file or spp")
        if needs.cold and self.warmup:
            raise UsageError(f"{self.name}: '{name}' starts from nothing: it needs warmup = 0")
        if needs.sequences and (self.keep != "all" or self.frames < 2):
            raise UsageError(f"{self.name}: '{name}' needs keep = 'all' and at least 2 frames")
        if needs.sequences and self.stride > 1:
            raise UsageError(f"{self.name}: '{name}' needs consecutive frames: stride = 1")
        if self.runs < needs.least_runs:
            raise UsageError(f"{self.name}: '{name}' needs at least {needs.least_runs} runs")
