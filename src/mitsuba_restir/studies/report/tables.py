"""The tables of a report as HTML: the headline, all numbers, and where they come from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from itertools import groupby

from ..measure.results import Row
from .headline import Cell, Headline, ends, percent


def breakable(name: str) -> str:
    """Escape a variant's name, and let it break after its words."""
    return escape(name).replace("_", "_<wbr>")


def headline_table(table: Headline, baselines: Mapping[str, str]) -> str:
    """
    Write the headline table.

    Parameters
    ----------
    baselines : mapping of str to str
        What each variant is compared with; itself for a baseline.
    """
    if not table.headings:
        return ""
    heads = "".join(f"<th>{escape(text)}</th>" for text in table.headings)
    body = ""
    for name, cells in table.lines.items():
        other = baselines.get(name, name)
        against = f"<small>against {breakable(other)}</small>" if other != name else ""
        body += f'<tr><th scope="row"><b>{breakable(name)}</b>{against}</th>'
        body += "".join(map(_cell, cells)) + "</tr>"
    return (
        '<div class="wide"><table class="headline"><thead><tr><th>Variant</th>'
        f"{heads}</tr></thead><tbody>{body}</tbody></table></div>"
        '<p class="legend">Under each value its 95 % interval over independent runs, and the '
        "change against the baseline on the same runs; "
        '<span class="better">better</span> or <span class="worse">worse</span> where the whole '
        "interval is on one side and p is below 0.05, which by sign flips takes 6 runs.</p>"
    )


def _cell(cell: Cell | None) -> str:
    if cell is None:
        return "<td></td>"
    parts = [f"<b>{escape(cell.value)}</b>"]
    if cell.interval:
        parts.append(f"<small>{escape(cell.interval)}</small>")
    if cell.ratio:
        parts.append(f"<span>{escape(cell.ratio)}</span>")
    if cell.published:
        parts.append(f"<i>published {escape(cell.published)}</i>")
    return f'<td class="{cell.verdict}">{"".join(parts)}</td>'


def number_table(rows: Sequence[Row]) -> str:
    """Write every number, one block for each quantity, with a field to search them by."""
    body = ""
    for (size, quantity), group in groupby(rows, key=lambda row: (row.size, row.quantity)):
        body += f'<tbody><tr><th colspan="6">{escape(quantity)} <small>{escape(size)}</small></th>'
        body += "</tr>" + "".join(map(_row, group)) + "</tbody>"
    heads = ("variant", "value", "95 % interval", "change", "p", "runs")
    head = "".join(f"<th>{name}</th>" for name in heads)
    return (
        '<p><input class="search" type="search" placeholder="search quantities and variants" '
        'aria-label="search quantities and variants"></p>'
        f'<div class="scroll"><table class="numbers"><thead><tr>{head}</tr></thead>{body}</table>'
        "</div>"
    )


def _row(row: Row) -> str:
    unit = f" {row.unit}" if row.unit else ""
    cells = (
        escape(f"{row.value.value:.5g}{unit}"),
        escape(ends(row.value)),
        "" if row.ratio is None else escape(percent(row.ratio)),
        "" if row.p_value is None else f"{row.p_value:.2g}",
        str(row.runs),
    )
    columns = "".join(f"<td>{cell}</td>" for cell in cells)
    return f"<tr><td>{breakable(row.variant)}</td>{columns}</tr>"


def environment_tables(environments: Sequence[Mapping[str, str | int]]) -> str:
    """Write the machines and versions that worked on a study."""
    lists = ""
    for environment in environments:
        items = "".join(
            f"<div><dt>{escape(name)}</dt><dd>{escape(str(value))}</dd></div>"
            for name, value in environment.items()
        )
        lists += f'<dl class="facts">{items}</dl>'
    return lists
