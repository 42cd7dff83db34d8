"""From finished runs to rows: every quantity of a study, size by size and across sizes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from ...errors import RenderError
from ..config.study import Study
from .asked import shows_images
from .quantities import QUANTITIES
from .results import Measured, Number, Refused, Row
from .rows import lone, make_row

_BLUR = Number("Gaussian of the blur", "px")


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
        An image holds values that are not finite.
    """
    rows: list[Row] = [
        make_row(data, name, _BLUR, lone(sigma)) for name, sigma in data.blurs.items()
    ]
    notes: list[str] = []
    if shows_images(study):
        data = replace(data, runs={name: runs for name, runs in data.runs.items() if runs})
    try:
        if shows_images(study) and not data.runs.get(data.baseline):
            raise ValueError(f"the baseline '{data.baseline}' has no finished run")
        for name in study.quantities:
            found = list(_rows(name, data))
            # Quantities yield all rows of a variant; readers compare variants of a quantity.
            rows += [row for row in found if isinstance(row, Row)]
            notes += [refused.reason for refused in found if isinstance(refused, Refused)]
    except ValueError as error:
        raise RenderError(f"{study.name} at {data.size} cannot be measured: {error}") from error
    # Two quantities may share numbers: the first to be asked for has them.
    once = {(row.quantity, row.variant): row for row in reversed(rows)}
    order = list(dict.fromkeys(row.quantity for row in rows))
    variants = list(data.variants)
    return sorted(
        once.values(), key=lambda row: (order.index(row.quantity), variants.index(row.variant))
    ), notes


def _rows(name: str, data: Measured) -> Iterator[Row | Refused]:
    """Yield the rows of a quantity, and a refusal for those that need a package that is missing."""
    try:
        yield from QUANTITIES[name].rows(data)
    except ImportError as error:
        yield Refused(f"{name} at {data.size} is not given in full: {error}")
