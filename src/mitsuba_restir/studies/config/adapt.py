"""Changing a study as a whole: another scene, a quick look, fewer variants."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from ...errors import UsageError
from .study import Reference, Size, Study

_QUICK_PIXELS = 160 * 90
_QUICK_REFERENCE = Reference(spp=512, batches=16)
_REFERENCE = Reference(spp=2048, batches=32)

_AS_IT_WAS = (
    "No published values are shown. What follows is about the study as it was, with its own scene, "
    "sizes and frames."
)


def adapt(study: Study, scene: str | None, small: bool) -> Study:
    """Put another scene in a study if one is given, and make it a quick look if wanted."""
    if scene:
        study = on_scene(study, scene)
    return quick(study) if small else study


def on_scene(study: Study, scene: str) -> Study:
    """Put another scene in a study: its whole view, a rendered reference, no published values."""
    reference = study.reference
    if reference is not None and not reference.seconds:
        reference = _REFERENCE
    return replace(
        study,
        scene=scene,
        view=None,
        crop=None,
        reference=reference,
        published={},
        about=_about(f"The variants of “{study.name}” in another scene.", study.about),
    )


def quick(study: Study) -> Study:
    """
    Make a study small enough for a few minutes: a first look, not a measurement.

    Small images, at most 4 runs of 6 frames after 8, one run of every probe, a rendered reference.
    """
    reference = None if study.reference is None else _QUICK_REFERENCE
    sizes = tuple(dict.fromkeys(_smaller(size) for size in study.sizes))
    look = "A quick look at small images: its numbers only show that everything works."
    return replace(
        study,
        sizes=sizes,
        runs=min(study.runs, 4),
        probe_runs=1,
        frames=min(study.frames, 6),
        warmup=min(study.warmup, 8),
        stride=1,
        reference=reference,
        published={},
        about=_about(look, study.about),
    )


def without(study: Study, names: Collection[str]) -> Study:
    """
    Leave variants out.

    Raises
    ------
    UsageError
        One does not exist, or none is left.
    """
    for name in names:
        if name not in study.variants:
            raise UsageError(
                f"no variant '{name}' to leave out: there are {', '.join(study.variants)}"
            )
    left = {name: v for name, v in study.variants.items() if name not in names}
    for name, variant in left.items():
        for other in (variant.of, variant.blur_to):
            if other in names:
                raise UsageError(f"'{name}' is made of '{other}': leave it out as well")
    if not left:
        raise UsageError(f"{study.name}: no variant is left")
    lost = {n: replace(v, baseline="") if v.baseline in names else v for n, v in left.items()}
    baseline = "" if study.baseline in names else study.baseline
    published = {n: values for n, values in study.published.items() if n in left}
    return replace(study, variants=lost, baseline=baseline, published=published)


def _about(change: str, original: str) -> str:
    """Say what was changed; what the study says of its frames and of others' values is its own."""
    if not original:
        return change
    # A study may be changed twice.
    link = " " if _AS_IT_WAS in original else f" {_AS_IT_WAS}\n\n"
    return change + link + original


def _smaller(size: Size) -> Size:
    factor = min((_QUICK_PIXELS / (size[0] * size[1])) ** 0.5, 1.0)
    return max(round(size[0] * factor), 16), max(round(size[1] * factor), 16)
