"""An experiment as data: what is rendered, how often, and what is measured. Read from TOML."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from ..errors import UsageError
from . import fields
from .quantities import QUANTITIES

Vector = tuple[float, float, float]
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
class Variant:
    """
    One way to render the scene.

    Fields
    ------
    type : str
        Integrator plugin.
    spp : int
        Samples (for `restir_pt`: initial candidates) per pixel and frame.
    parameters : mapping
        The plugin's parameters; `max_depth` is the study's unless it is given here.
    """

    type: str
    spp: int = 1
    parameters: Mapping[str, Value] = field(default_factory=dict)


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
    """

    file: str = ""
    variance: str = ""
    spp: int = 0
    batches: int = 16


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
        Width and height in pixels; all variants are rendered at each.
    baseline : str
        The variant that ratios refer to; the first one by default.
    view : View or None
        None is the scene's own camera.
    max_depth : int
        Longest path in edges, for all variants and the reference; -1 is unlimited.
    frames, warmup : int
        Measured frames of a run, and frames of history rendered before them.
    runs : int
        Independent runs.
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
    """

    name: str
    scene: str
    variants: Mapping[str, Variant]
    sizes: Sequence[Size] = ((320, 180),)
    baseline: str = ""
    view: View | None = None
    max_depth: int = 10
    frames: int = 1
    warmup: int = 0
    runs: int = 2
    seed: int = 0
    quantities: Sequence[str] = ("time",)
    keep: str = "last"
    reference: Reference | None = None
    epsilon: float = 0.01
    trim: float = 0.001
    freeze: bool = True
    mitsuba_variant: str = "llvm_ad_rgb"

    def __post_init__(self) -> None:
        """Check what concerns several fields (UsageError)."""
        if not self.baseline:
            object.__setattr__(self, "baseline", next(iter(self.variants), ""))
        if self.baseline not in self.variants:
            raise UsageError(
                f"{self.name}: the baseline '{self.baseline}' is none of the variants "
                f"({', '.join(self.variants) or 'there are none'})"
            )
        unknown = [name for name in self.quantities if name not in QUANTITIES]
        if unknown:
            raise UsageError(
                f"{self.name}: unknown quantity '{unknown[0]}'; there are {', '.join(QUANTITIES)}"
            )
        for name in self.quantities:
            self._check_quantity(name)
        if self.reference and self.reference.file and len(self.sizes) > 1:
            raise UsageError(f"{self.name}: a reference file fits one size, not {len(self.sizes)}")

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
        if self.runs < needs.least_runs:
            raise UsageError(f"{self.name}: '{name}' needs at least {needs.least_runs} runs")


def to_table(study: Study) -> dict[str, Any]:
    """Return the study as a complete TOML table, defaults included."""
    table: dict[str, Any] = json.loads(json.dumps(asdict(study)))
    table["sizes"] = [f"{width}x{height}" for width, height in study.sizes]
    table["variants"] = {
        name: {"type": v.type, "spp": v.spp, **v.parameters} for name, v in study.variants.items()
    }
    return {key: value for key, value in table.items() if value is not None}


def from_table(table: Mapping[str, Any], source: str) -> Study:
    """
    Build a study from a TOML table.

    Parameters
    ----------
    table : mapping
        Parsed TOML.
    source : str
        Where it comes from, for messages.

    Raises
    ------
    UsageError
        A key is missing, unknown or of the wrong kind; says which and what is allowed.
    """
    reader = fields.Reader(table, source)
    variants = {name: _variant(reader.table("variants"), name) for name in _names(reader)}
    view = reader.table("view") if "view" in table else None
    reference = reader.table("reference") if "reference" in table else None
    study = Study(
        name=reader.text("name"),
        scene=reader.text("scene"),
        variants=variants,
        sizes=tuple(_size(text, source) for text in reader.texts("sizes", ("320x180",))),
        baseline=reader.text("baseline", ""),
        view=None if view is None else _view(view),
        max_depth=reader.integer("max_depth", 10, least=-1),
        frames=reader.integer("frames", 1, least=1),
        warmup=reader.integer("warmup", 0, least=0),
        runs=reader.integer("runs", 2, least=1),
        seed=reader.integer("seed", 0, least=0),
        quantities=reader.texts("quantities", ("time",)),
        keep=reader.choice("keep", "last", ("last", "all")),
        reference=None if reference is None else _reference(reference),
        epsilon=reader.number("epsilon", 0.01, positive=True),
        trim=reader.number("trim", 0.001),
        freeze=reader.flag("freeze", True),
        mitsuba_variant=reader.text("mitsuba_variant", "llvm_ad_rgb"),
    )
    reader.finish()
    return study


def _names(reader: fields.Reader) -> list[str]:
    names = reader.table("variants").keys()
    for name in names:
        if not re.fullmatch(r"[A-Za-z0-9][\w+.-]*", name):
            raise UsageError(f"{reader.source}: '{name}' cannot name a variant: use a-z, 0-9, _+.-")
    if not names:
        raise UsageError(f"{reader.source}: [variants] is empty: name at least one")
    return names


def _variant(variants: fields.Reader, name: str) -> Variant:
    reader = variants.table(name)
    kind, spp = reader.text("type"), reader.integer("spp", 1, least=1)
    return Variant(kind, spp, reader.rest())


def _view(reader: fields.Reader) -> View:
    view = View(
        fov=reader.number("fov", positive=True),
        origin=reader.vector("origin"),
        target=reader.vector("target"),
        up=reader.vector("up", (0.0, 1.0, 0.0)),
    )
    reader.finish()
    return view


def _reference(reader: fields.Reader) -> Reference:
    reference = Reference(
        file=reader.text("file", ""),
        variance=reader.text("variance", ""),
        spp=reader.integer("spp", 0, least=0),
        batches=reader.integer("batches", 16, least=2),
    )
    reader.finish()
    if bool(reference.file) == bool(reference.spp):
        raise UsageError(f"{reader.source}: give either file or spp")
    if reference.spp % reference.batches:
        raise UsageError(
            f"{reader.source}: spp = {reference.spp} is no multiple of the "
            f"{reference.batches} batches"
        )
    return reference


def _size(text: str, source: str) -> Size:
    found = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    size = (int(found[1]), int(found[2])) if found else (0, 0)
    if min(size) < 1:
        raise UsageError(f"{source}: sizes must be like '320x180', not '{text}'")
    return size
