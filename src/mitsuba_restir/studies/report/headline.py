"""The headline table: one line for each variant, with what matters most about it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ...analysis.intervals import Interval
from ..measure.quantities import NUMBERS
from ..measure.results import Number, Row

# A ratio whose interval spans more than this factor says nothing.
_WIDEST = 20.0
_LEVEL = 0.05


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
        "better" or "worse" where the whole interval and the test say so, else "".
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
    columns = [
        number
        for number in NUMBERS.values()
        if number.heading and number.name in quantities and number.yields_to not in quantities
    ]
    variants = dict.fromkeys(row.variant for row in rows if row.size == size)
    lines = {
        name: [
            _cell(found.get((name, number.name)), number, published.get(name, {}).get(number.name))
            for number in columns
        ]
        for name in variants
    }
    return Headline([number.heading for number in columns], lines)


def _cell(row: Row | None, number: Number, published: float | None) -> Cell | None:
    if row is None:
        return None
    unit = f" {row.unit}" if row.unit else ""
    other = "" if published is None else f"{published:.4g}{unit}"
    if not number.better:
        return Cell(_percentage(row.value.value), _percentages(row.value), published=other)
    ratio, verdict = "", ""
    if row.ratio is not None:
        ratio = percent(row.ratio)
        if _is_sure(row.ratio, row.p_value):
            verdict = "better" if (row.ratio.high < 1.0) == (number.better == "less") else "worse"
    elif number.better == "more" and (row.value.high < 1.0 or row.value.low > 1.0):
        verdict = "better" if row.value.low > 1.0 else "worse"
    return Cell(f"{short(row.value.value)}{unit}", ends(row.value), ratio, verdict, other)


def _is_sure(ratio: Interval, p_value: float | None) -> bool:
    """Say whether a ratio is not 1, by its interval and, where there is one, by its test."""
    apart = ratio.high < 1.0 or ratio.low > 1.0
    return is_clear(ratio) and apart and (p_value is None or p_value < _LEVEL)


def is_clear(ratio: Interval) -> bool:
    """Say whether a ratio means anything: negative covariances and single runs make none."""
    return 0.0 < ratio.low and ratio.high < _WIDEST * ratio.low


def short(value: float) -> str:
    """Write a number with three digits, or as many as it takes to be whole."""
    text = f"{value:.3g}"
    if "e" not in text:
        return text
    if 1e3 <= abs(value) < 1e6:
        return f"{value:.0f}"
    digits, _, exponent = text.partition("e")
    return f"{digits}e{int(exponent)}"


def ends(interval: Interval) -> str:
    """Write an interval; nothing where there is none."""
    if not (math.isfinite(interval.low) and math.isfinite(interval.high)):
        return ""
    return f"{short(interval.low)} … {short(interval.high)}"


def _percentage(share: float) -> str:
    return f"{100.0 * share:.2f} %"


def _percentages(interval: Interval) -> str:
    if not (math.isfinite(interval.low) and math.isfinite(interval.high)):
        return ""
    return f"{100 * interval.low:.2f} … {100 * interval.high:.2f}"


def percent(ratio: Interval) -> str:
    """Write a ratio as a change in percent, or as a factor where it is large."""
    if not (math.isfinite(ratio.low) and math.isfinite(ratio.high)):
        return f"{100.0 * (ratio.value - 1.0):+.1f} %"
    if not is_clear(ratio):
        return "not resolved"
    if ratio.value >= 2.0:
        return f"× {short(ratio.value)} ({short(ratio.low)} … {short(ratio.high)})"
    change, low, high = (100.0 * (x - 1.0) for x in (ratio.value, ratio.low, ratio.high))
    digits = 0 if high - low > 25.0 else 1
    return f"{change:+.{digits}f} % ({low:+.{digits}f} … {high:+.{digits}f})"
