"""Studies as TOML tables: every key checked, every default written out."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from ...errors import UsageError
from . import fields
from .study import REFERENCE, Crop, Motion, Reference, Size, Study, Variant, View


def to_table(study: Study) -> dict[str, Any]:
    """Return the study as a complete TOML table, defaults included."""
    table: dict[str, Any] = json.loads(json.dumps(asdict(study)))
    table["sizes"] = [f"{width}x{height}" for width, height in study.sizes]
    table["variants"] = {name: _variant_table(v) for name, v in study.variants.items()}
    # These came later: studies without them keep the digests of their finished runs.
    if study.stride == 1:
        del table["stride"]
    if study.reference is not None and not study.reference.noise:
        del table["reference"]["noise"]
    if study.motion is not None and not study.motion.light:
        table["motion"] = {"step": list(study.motion.step)}
    return {key: value for key, value in table.items() if value is not None}


def _variant_table(variant: Variant) -> dict[str, Any]:
    made = {"of": variant.of, "blur_to": variant.blur_to}
    rendered = {"type": variant.type, "spp": variant.spp, **variant.parameters}
    optional = {"shows": variant.shows, "baseline": variant.baseline}
    return {
        **(made if variant.of else rendered),
        **{name: text for name, text in optional.items() if text},
    }


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
    motion = reader.table("motion") if "motion" in table else None
    reference = reader.table("reference") if "reference" in table else None
    study = Study(
        name=_name(reader),
        scene=reader.text("scene"),
        variants=variants,
        sizes=_sizes(reader),
        baseline=reader.text("baseline", ""),
        view=None if view is None else _view(view),
        crop=_crop(reader),
        motion=None if motion is None else _motion(motion),
        max_depth=reader.integer("max_depth", 10, least=-1),
        frames=reader.integer("frames", 1, least=1),
        warmup=reader.integer("warmup", 0, least=0),
        stride=reader.integer("stride", 1, least=1),
        runs=reader.integer("runs", 2, least=1),
        probe_runs=reader.integer("probe_runs", 2, least=1),
        seed=reader.integer("seed", 0, least=0),
        quantities=reader.texts("quantities", ("time",)),
        keep=reader.choice("keep", "last", ("last", "all")),
        reference=None if reference is None else _reference(reference),
        epsilon=reader.number("epsilon", 0.01, positive=True),
        trim=reader.number("trim", 0.001, below=1.0),
        freeze=reader.flag("freeze", True),
        mitsuba_variant=_mitsuba_variant(reader),
        about=reader.text("about", ""),
        published=_published(reader.table("published")) if "published" in table else {},
    )
    reader.finish()
    return study


def _name(reader: fields.Reader) -> str:
    name = reader.text("name")
    # It becomes a part of the folder's name.
    if not name.isprintable() or set(name) & set("/\\"):
        raise UsageError(
            f"{reader.source}: name must be printable and without / and \\, not {name!r}"
        )
    return name


def _mitsuba_variant(reader: fields.Reader) -> str:
    variant = reader.text("mitsuba_variant", "llvm_ad_rgb")
    if not re.fullmatch(r"(?!scalar)\w+_rgb", variant):
        raise UsageError(
            f"{reader.source}: mitsuba_variant must be one of colour that is compiled, as in "
            f"llvm_ad_rgb or cuda_ad_rgb, not '{variant}'"
        )
    return variant


def _names(reader: fields.Reader) -> list[str]:
    names = reader.table("variants").keys()
    for name in names:
        if not re.fullmatch(r"[A-Za-z0-9][\w+.-]*", name):
            raise UsageError(f"{reader.source}: '{name}' cannot name a variant: use a-z, 0-9, _+.-")
        if name == REFERENCE:
            raise UsageError(f"{reader.source}: '{name}' is what the truth is called: name it else")
    if not names:
        raise UsageError(f"{reader.source}: [variants] is empty: name at least one")
    return names


def _variant(variants: fields.Reader, name: str) -> Variant:
    reader = variants.table(name)
    baseline = reader.text("baseline", "")
    if "of" in reader.keys():
        made = Variant(of=reader.text("of"), blur_to=reader.text("blur_to"), baseline=baseline)
        reader.finish()
        return made
    kind, spp = reader.text("type"), reader.integer("spp", 1, least=1)
    shows = reader.text("shows", "")
    return Variant(kind, spp, reader.rest(), baseline, shows)


def _view(reader: fields.Reader) -> View:
    view = View(
        fov=reader.number("fov", positive=True, below=180.0),
        origin=reader.vector("origin"),
        target=reader.vector("target"),
        up=reader.vector("up", (0.0, 1.0, 0.0)),
    )
    reader.finish()
    direction = np.subtract(view.target, view.origin)
    if not direction.any():
        raise UsageError(f"{reader.source}: target must differ from origin, {list(view.origin)}")
    if not np.cross(direction, view.up).any():
        raise UsageError(f"{reader.source}: up must point elsewhere than the view")
    return view


def _crop(reader: fields.Reader) -> Crop | None:
    crop = reader.numbers("crop", 4)
    if crop is None:
        return None
    left, top, width, height = crop
    if min(left, top) < 0.0 or min(width, height) <= 0.0 or max(left + width, top + height) > 1.0:
        raise UsageError(
            f"{reader.source}: crop must be left, top, width and height inside 0 ... 1, not "
            f"{list(crop)}"
        )
    return left, top, width, height


def _published(reader: fields.Reader) -> dict[str, dict[str, float]]:
    return {
        variant: {name: values.number(name) for name in values.keys()}
        for variant in reader.keys()
        for values in (reader.table(variant),)
    }


def _motion(reader: fields.Reader) -> Motion:
    still = (0.0, 0.0, 0.0)
    motion = Motion(
        reader.vector("step", still),
        reader.text("light", ""),
        reader.vector("light_step", still),
    )
    reader.finish()
    if motion.step == still and not motion.light:
        raise UsageError(f"{reader.source}: give a step of the camera, or a light and its step")
    if (motion.light_step == still) != (not motion.light):
        raise UsageError(f"{reader.source}: light and light_step go together")
    return motion


def _reference(reader: fields.Reader) -> Reference:
    reference = Reference(
        file=reader.text("file", ""),
        variance=reader.text("variance", ""),
        spp=reader.integer("spp", 0, least=0),
        batches=reader.integer("batches", 16, least=2),
        smooth=reader.number("smooth", 0.0),
        noise=reader.number("noise", 0.0),
    )
    reader.finish()
    if bool(reference.file) == bool(reference.spp):
        raise UsageError(f"{reader.source}: give either file or spp")
    if reference.variance and not reference.file:
        raise UsageError(
            f"{reader.source}: variance goes with file; that of spp follows from its batches"
        )
    if reference.spp % reference.batches:
        raise UsageError(
            f"{reader.source}: spp = {reference.spp} is no multiple of the "
            f"{reference.batches} batches"
        )
    return reference


def _sizes(reader: fields.Reader) -> tuple[Size, ...]:
    sizes = tuple(_size(text, reader.source) for text in reader.texts("sizes", ("320x180",)))
    twice = [size for index, size in enumerate(sizes) if size in sizes[:index]]
    if twice:
        width, height = twice[0]
        raise UsageError(f"{reader.source}: sizes has {width}x{height} twice")
    return sizes


def _size(text: str, source: str) -> Size:
    found = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    size = (int(found[1]), int(found[2])) if found else (0, 0)
    if min(size) < 1:
        raise UsageError(f"{source}: sizes must be like '320x180', not '{text}'")
    return size
