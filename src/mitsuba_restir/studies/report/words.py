"""What a report says in words: facts of a study, how sure its reference is, captions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...imageio import Image
from ..config.study import Reference, Study
from ..measure.quantities import NUMBERS
from ..measure.results import Measured, Row
from ..runs.results import ReferenceImage
from .headline import short


def about_errors(data: Measured, quantities: set[str]) -> str:
    """Say how sure the reference is, where that is known, and what clipping does."""
    reference = data.reference
    sentences = []
    if reference is not None and reference.variance.any():
        relative = np.sqrt(reference.luminance_variance) / np.maximum(reference.luminance, 1e-30)
        median, worst = 100.0 * np.percentile(relative[reference.luminance > 0.0], [50.0, 90.0])
        sentences.append(
            "Squared errors and powers are without the reference's own error, which is "
            f"{median:.2g} % of a pixel's luminance in the median and {worst:.2g} % at the 90th "
            "percentile."
        )
        perfect = _with_its_noise(reference)
        said = set()
        for number in (n for n in NUMBERS.values() if n.name in quantities):
            if number.keeps_part:
                sentences.append(f"A part of it stays in “{number.name}”.")
            if number.keeps_all and number.keeps_all not in said:
                said.add(number.keeps_all)
                sentences.append(
                    f"All of it stays in “{number.name}”: of a perfect image it would be about "
                    f"{number.keeps_all(data, perfect, reference):.2g}."
                )
    if any("clipped" in name for name in quantities):
        sentences.append(
            "What is clipped favours images that are too dark: of errors that are very bright only "
            "a part counts. Look at the mean and at what is not clipped, too."
        )
    return " ".join(sentences)


def _with_its_noise(reference: ReferenceImage) -> Image:
    """Return what differs from a reference as the truth does: by noise of the same variance."""
    noise = np.random.default_rng(0).standard_normal((*reference.image.shape[:2], 1))
    image = reference.image + np.sqrt(reference.variance) * noise
    return np.maximum(image, 0.0).astype(np.float32)


def captions(rows: Sequence[Row], size: str) -> dict[str, str]:
    """Return a number for every variant, for where there is little room."""
    for number in (n for n in reversed(list(NUMBERS.values())) if n.caption):
        own = [row for row in rows if row.quantity == number.name and row.size == size]
        if own:
            return {
                row.variant: f"{number.caption} {short(row.value.value)} {row.unit}".rstrip()
                for row in own
            }
    return {}


def facts(study: Study, samples: Mapping[str, int]) -> dict[str, str]:
    """Return what the reader should know, with the samples of the reference of every size."""
    apart = f", {study.stride} apart" if study.stride > 1 else ""
    facts = {
        "Scene": study.scene,
        "Longest path": "unlimited" if study.max_depth < 0 else f"{study.max_depth} edges",
        "Frames": f"{study.frames}{apart} after {study.warmup} of history",
        "Independent runs": str(study.runs),
        "Baseline": study.baseline,
    }
    if study.reference is not None:
        facts["Reference"] = _origin(study.reference, samples)
    return facts


def _origin(reference: Reference, samples: Mapping[str, int]) -> str:
    """Say what a reference is made of: fewer samples than asked for where its noise allowed it."""
    if reference.file:
        origin = reference.file
    elif len(set(samples.values())) == 1:
        origin = f"path, {next(iter(samples.values()))} samples per pixel"
    else:
        counts = ", ".join(f"{count} at {size}" for size, count in samples.items())
        origin = f"path, samples per pixel: {counts}"
    smooth = f", smoothed by a Gaussian of {reference.smooth:g} px" if reference.smooth else ""
    return origin + smooth
