"""The reference of a study: batches that are rendered once and kept for all studies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from ...errors import UsageError
from ..config.study import REFERENCE, Reference, Size, Study, Variant
from ..runs.reference import LEAST_BATCHES, BatchMean, read_reference, smooth
from ..runs.rendering import ENDLESS, REFERENCE_KEY, make_renderer, seed_of
from ..runs.results import Image, ReferenceImage
from ..runs.stills import TYPE
from .folder import StudyFolder


def missing_batches(folder: StudyFolder, size: Size) -> int:
    """Return how many batches are still to be rendered, at most."""
    reference = folder.study.reference
    if reference is None or reference.file or _mean(folder, size, reference) is not None:
        return 0
    return sum(folder.load_batch(size, b) is None for b in range(reference.batches))


def _is_enough(mean: BatchMean, asked: Reference) -> bool:
    """
    Say whether no more batches are wanted.

    They are enough when they are all, or when the mean of at least 8 is as sure as the study asks:
    the same ones however many more another study has rendered.
    """
    if mean.count == asked.batches:
        return True
    return 0.0 < asked.noise and mean.count >= LEAST_BATCHES and mean.image().noise <= asked.noise


def _mean(
    folder: StudyFolder,
    size: Size,
    reference: Reference,
    render: Callable[[int], Image] | None = None,
) -> ReferenceImage | None:
    """Return the reference; None where a batch that it needs is neither there nor rendered."""
    mean = BatchMean(size)
    while not _is_enough(mean, reference):
        batch = folder.load_batch(size, mean.count)
        if batch is None:
            if render is None:
                return None
            batch = render(mean.count)
            folder.save_batch(size, mean.count, batch)
        mean.add(batch, reference.batch_spp or 1)
    image = mean.image()
    return replace(image, samples=0) if reference.seconds else image


def render_batches(folder: StudyFolder, scene: Any, size: Size, done: Callable[[], None]) -> None:
    """Render and save the batches that are needed and not there, calling `done` for each."""
    study = folder.study
    assert study.reference is not None
    if study.reference.seconds:
        variant = Variant(TYPE, parameters={"seconds": study.reference.seconds})
    else:
        variant = Variant("path", study.reference.batch_spp, ENDLESS)
    renderer = make_renderer(study, scene, size, REFERENCE, variant)

    def render(index: int) -> Image:
        image, _ = renderer.frame(seed_of(0, REFERENCE_KEY, index))
        done()
        return image

    _mean(folder, size, study.reference, render)


def load_reference(folder: StudyFolder, size: Size) -> ReferenceImage | None:
    """Return the finished reference of a size; None where the study has none."""
    reference = folder.study.reference
    if reference is None:
        return None
    if reference.file:
        return smooth(read_reference(folder.study), reference.smooth)
    found = _mean(folder, size, reference)
    if found is None:
        raise UsageError(f"{folder.path}: batches of the reference are missing")
    return smooth(found, reference.smooth)


def notes_on_reference(study: Study, reference: ReferenceImage | None) -> list[str]:
    """Say where a reference is not as sure as the study asks."""
    asked = study.reference
    if reference is None or asked is None:
        return []
    if asked.file and not asked.variance:
        return [
            f"the error of the reference {asked.file} is not known: it counts as that of every "
            "variant, and tests of bias take it as exact; a variance can be given"
        ]
    if asked.smooth or not 0.0 < asked.noise < reference.noise:
        return []
    return [
        f"the reference's noise is {100 * reference.noise:.2g} % in the median, not "
        f"{100 * asked.noise:.2g} %: it needs more batches"
    ]
