"""From finished runs to rows: every quantity of a study, size by size and across sizes."""

from __future__ import annotations

from collections.abc import Sequence

from ..errors import RenderError
from .config import Study
from .quantities import QUANTITIES
from .results import Measured, Row


def measure_size(study: Study, data: Measured) -> list[Row]:
    """
    Measure everything that a study asks for at one size.

    Raises
    ------
    RenderError
        An image holds values that are not finite, or a package is missing.
    """
    try:
        if study.shows_images() and not data.runs.get(data.baseline):
            raise ValueError(f"the baseline '{data.baseline}' has no finished run")
        # Quantities yield all rows of a variant; readers compare variants of a quantity.
        rows = [row for name in study.quantities for row in QUANTITIES[name].rows(data)]
    except (ValueError, ImportError) as error:
        raise RenderError(f"{study.name} at {data.size} cannot be measured: {error}") from error
    order = list(dict.fromkeys(row.quantity for row in rows))
    return sorted(rows, key=lambda row: order.index(row.quantity))


def measure_across(study: Study, sizes: Sequence[Measured]) -> list[Row]:
    """Measure what follows from all sizes together."""
    found = [QUANTITIES[name].across for name in study.quantities]
    return [row for across in found if across is not None for row in across(sizes)]
