"""From finished runs to rows: every quantity of a study, size by size and across sizes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...errors import RenderError
from ..config.study import Study
from .quantities import QUANTITIES
from .results import Measured, Refused, Row
from .scalars import lone


def measure_size(study: Study, data: Measured) -> tuple[list[Row], list[str]]:
    """
    Measure everything that a study asks for at one size.

    Returns
    -------
    rows : list of Row
    notes : list of str
        What was asked for but cannot be given, and why.

    Raises
    ------
    RenderError
        An image holds values that are not finite, or a package is missing.
    """
    rows: list[Row] = [
        Row(data.size, name, "Gaussian of the blur", "px", lone(sigma), None, len(data.runs[name]))
        for name, sigma in data.blurs.items()
    ]
    notes: list[str] = []
    if study.shows_images():
        data = replace(data, runs={name: runs for name, runs in data.runs.items() if runs})
    try:
        if study.shows_images() and not data.runs.get(data.baseline):
            raise ValueError(f"the baseline '{data.baseline}' has no finished run")
        for name in study.quantities:
            found = list(QUANTITIES[name].rows(data))
            # Quantities yield all rows of a variant; readers compare variants of a quantity.
            rows += [row for row in found if isinstance(row, Row)]
            notes += [refused.reason for refused in found if isinstance(refused, Refused)]
    except (ValueError, ImportError) as error:
        raise RenderError(f"{study.name} at {data.size} cannot be measured: {error}") from error
    # Two quantities may share numbers: the first to be asked for has them.
    once = {(row.quantity, row.variant): row for row in reversed(rows)}
    order = list(dict.fromkeys(row.quantity for row in rows))
    variants = list(data.variants)
    return sorted(
        once.values(), key=lambda row: (order.index(row.quantity), variants.index(row.variant))
    ), notes


def measure_across(study: Study, sizes: Sequence[Measured]) -> list[Row]:
    """Measure what follows from all sizes together."""
    found = [QUANTITIES[name].across for name in study.quantities]
    return [row for across in found if across is not None for row in across(sizes)]
