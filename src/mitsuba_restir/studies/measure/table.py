"""The numbers of a study as a table: on the terminal, as CSV and as JSON."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import rich.table
from rich.console import Console

from ...analysis.intervals import Interval
from .results import Row

Record = dict[str, str | int | float | None]

_COLUMNS = (
    "size",
    "quantity",
    "variant",
    "unit",
    "value",
    "low",
    "high",
    "ratio",
    "ratio_low",
    "ratio_high",
    "p_value",
    "runs",
)


@dataclass(frozen=True)
class Table:
    """
    Rows of numbers, and how they are shown.

    Fields
    ------
    rows : sequence of Row
    notes : sequence of str
        What the user should know about them, such as files that could not be used.
    published : mapping of str to mapping of str to float
        Values of others, by variant and quantity; a column where any row has one.
    """

    rows: Sequence[Row]
    notes: Sequence[str] = ()
    published: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def records(self) -> list[Record]:
        """Return one flat record for each row; None where a number is not defined."""
        if not self._shows_published:
            return [_record(row) for row in self.rows]
        return [{**_record(row), "published": self._published(row)} for row in self.rows]

    def _published(self, row: Row) -> float | None:
        return self.published.get(row.variant, {}).get(row.quantity)

    @property
    def _shows_published(self) -> bool:
        return any(self._published(row) is not None for row in self.rows)

    def csv(self) -> str:
        """Return the records as CSV with a header."""
        text = io.StringIO()
        columns = [*_COLUMNS, "published"] if self._shows_published else _COLUMNS
        writer = csv.DictWriter(text, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(self.records())
        return text.getvalue()

    def json(self) -> str:
        """Return the records as a JSON list."""
        return json.dumps(self.records(), indent=1, allow_nan=False) + "\n"

    def show(self, console: Console, title: str) -> None:
        """Print the table."""
        table = rich.table.Table(title=title, title_justify="left")
        for name in ("size", "quantity", "variant"):
            table.add_column(name, overflow="fold")
        for name in ("value", "95 % interval", "to baseline", "95 % interval", "p"):
            table.add_column(name, justify="right", no_wrap=True)
        if self._shows_published:
            table.add_column("published", justify="right", no_wrap=True)
        before: tuple[str, str] | None = None
        for row in self.rows:
            group = (row.size, row.quantity)
            if before is not None and group != before:
                table.add_section()
            head = group if group != before else ("", "")
            before = group
            unit = f" {row.unit}" if row.unit else ""
            ratio = ("", "") if row.ratio is None else _texts(row.ratio, "")
            p_value = "" if row.p_value is None else f"{row.p_value:.2g}"
            cells = [*_texts(row.value, unit), *ratio, p_value]
            if self._shows_published:
                other = self._published(row)
                cells.append("" if other is None else f"{other:.4g}{unit}")
            table.add_row(*head, row.variant, *cells)
        console.print(table)


def _texts(interval: Interval, unit: str) -> tuple[str, str]:
    value = f"{interval.value:.4g}{unit}"
    if math.isnan(interval.low):
        return value, ""
    return value, f"{interval.low:.4g} .. {interval.high:.4g}"


def _record(row: Row) -> Record:
    ratio = row.ratio
    return {
        "size": row.size,
        "quantity": row.quantity,
        "variant": row.variant,
        "unit": row.unit,
        "value": _number(row.value.value),
        "low": _number(row.value.low),
        "high": _number(row.value.high),
        "ratio": None if ratio is None else _number(ratio.value),
        "ratio_low": None if ratio is None else _number(ratio.low),
        "ratio_high": None if ratio is None else _number(ratio.high),
        "p_value": row.p_value,
        "runs": row.runs,
    }


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
