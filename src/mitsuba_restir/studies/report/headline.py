"""The headline table: one line for each variant, with what matters most about it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ...analysis.intervals import Interval
from ..results import Row

# Quantity, heading, and whether less is better.
_COLUMNS = (
    ("time of a frame", "Time of a frame", True),
    ("RMSE", "RMSE", True),
    ("relMSE, trimmed", "relMSE, trimmed", True),
    ("relMSE of the average", "relMSE of the average", True),
    ("relative covariance r=8", "Relative covariance", True),
    ("relative covariance r=8, clipped", "Covariance, clipped", True),
    ("covariance r=8 within a sequence", "Covariance within a sequence", True),
    ("power 0.02-0.06", "Power .02–.06 c/px", True),
    ("filtered MSE, 1.5 px", "Filtered MSE", True),
    ("relMSE after OIDN", "relMSE after OIDN", True),
    ("HDR-FLIP after OIDN", "FLIP after OIDN", True),
    ("equal time: last frame at its own time", "Equal time, last frame", False),
    ("equal time: last frame charged with all", "Equal time, charged with all", False),
    ("equal time: average of all frames", "Equal time, average", False),
)


@dataclass(frozen=True)
class Cell:
    """
    One number of the table.

    Fields
    ------
    value, interval : str
    ratio : str
        Change against the variant's baseline, with its interval; empty without one.
    verdict : str
        "better" or "worse" where the whole interval says so, else "".
    published : str
        The value of others; empty without one.
    """

    value: str
    interval: str = ""
    ratio: str = ""
    verdict: str = ""
    published: str = ""


@dataclass(frozen=True)
class Headline:
    """Headings, and for each variant a cell under every heading (None where it has no number)."""

    headings: list[str]
    lines: dict[str, list[Cell | None]]


def headline(
    rows: Sequence[Row], size: str, published: Mapping[str, Mapping[str, float]]
) -> Headline:
    """Choose the numbers of one size that make up the headline table."""
    found = {(row.variant, row.quantity): row for row in rows if row.size == size}
    quantities = {quantity for _, quantity in found}
    columns = [column for column in _COLUMNS if column[0] in quantities]
    variants = dict.fromkeys(row.variant for row in rows if row.size == size)
    lines = {
        name: [
            _cell(found.get((name, quantity)), less, published.get(name, {}).get(quantity))
            for quantity, _, less in columns
        ]
        for name in variants
    }
    return Headline([heading for _, heading, _ in columns], lines)


def _cell(row: Row | None, less_is_better: bool, published: float | None) -> Cell | None:
    if row is None:
        return None
    unit = f" {row.unit}" if row.unit else ""
    ratio, verdict = "", ""
    if row.ratio is not None:
        ratio = percent(row.ratio)
        # A negative covariance makes a ratio that says nothing.
        if row.ratio.low > 0.0 and (row.ratio.high < 1.0 or row.ratio.low > 1.0):
            verdict = "better" if (row.ratio.high < 1.0) == less_is_better else "worse"
    elif not less_is_better and (row.value.high < 1.0 or row.value.low > 1.0):
        verdict = "better" if row.value.low > 1.0 else "worse"
    other = "" if published is None else f"{published:.4g}{unit}"
    return Cell(f"{row.value.value:.4g}{unit}", ends(row.value), ratio, verdict, other)


def ends(interval: Interval) -> str:
    """Write an interval; nothing where there is none."""
    if not (math.isfinite(interval.low) and math.isfinite(interval.high)):
        return ""
    return f"{interval.low:.4g} … {interval.high:.4g}"


def percent(ratio: Interval) -> str:
    """Write a ratio as a change in percent, with its interval."""
    change = f"{100.0 * (ratio.value - 1.0):+.1f} %"
    if not (math.isfinite(ratio.low) and math.isfinite(ratio.high)):
        return change
    return f"{change} ({100 * (ratio.low - 1):+.1f} … {100 * (ratio.high - 1):+.1f})"
