"""What a study asks to be measured, and whether that can be."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator

from ...errors import UsageError
from ..config.study import Study
from .excess import shows_candidates
from .quantities import QUANTITIES

BENCHMARKS = ("rays", "kernels", "memory", "startup")
"""What was a quantity once, and is measured by ``python -m benchmarks.NAME``."""


def check_quantities(study: Study) -> None:
    """
    Check that a study has what its quantities need.

    Raises
    ------
    UsageError
        A quantity does not exist, or the study lacks what it needs.
    """
    for name in study.quantities:
        if name not in QUANTITIES:
            raise UsageError(f"{study.name}: {_unknown_quantity(name)}")
        for lack in _lacks(study, name):
            raise UsageError(f"{study.name}: '{name}' {lack}")


def probes_of(study: Study) -> list[str]:
    """Return the probes that the quantities need."""
    found = (QUANTITIES[name].probe for name in study.quantities)
    return list(dict.fromkeys(probe for probe in found if probe))


def shows_images(study: Study) -> bool:
    """Return whether any quantity is measured from images or times of frames."""
    return any(not QUANTITIES[name].probe for name in study.quantities)


def _lacks(study: Study, name: str) -> Iterator[str]:
    needs = QUANTITIES[name]
    if needs.needs_reference and study.reference is None:
        yield "needs a [reference] with file or spp"
    if needs.cold and study.warmup and not study.cuts:
        yield "starts from nothing: it needs warmup = 0, or a camera that jumps after it"
    if needs.sequences and (study.keep != "all" or study.frames < 2):
        yield "needs keep = 'all' and at least 2 frames"
    if needs.sequences and study.stride > 1:
        yield "needs consecutive frames: stride = 1"
    if needs.needs_candidates and not any(map(shows_candidates, study.variants.values())):
        yield "needs a variant of candidates alone: temporal = false and spatial = false, or path"
    if needs.package and importlib.util.find_spec(needs.package) is None:
        yield f"needs pip install {needs.package.replace('_', '-')}"
    if lack := needs.lacks(study):
        yield lack
    if study.runs < needs.least_runs:
        yield f"needs at least {needs.least_runs} runs"


def _unknown_quantity(name: str) -> str:
    """Say what is wrong with the name of a quantity that there is not."""
    if name in BENCHMARKS:
        return f"'{name}' is a benchmark, no quantity: python -m benchmarks.{name} STUDY"
    return f"unknown quantity '{name}'; there are {', '.join(QUANTITIES)}"
