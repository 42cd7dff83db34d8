"""The report as one HTML page that needs nothing else."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from importlib import resources

from ...imageio import encode_png
from ..results import Row
from .headline import Headline, ends, percent
from .pictures import Gallery, Picture


@dataclass(frozen=True)
class Part:
    """
    What the report shows of one size.

    Fields
    ------
    size : str
    headline : Headline
    baseline : str
        The variant that the comparison starts with.
    galleries : sequence of Gallery
    figures : mapping of str to str
        Drawings as SVG, by caption.
    """

    size: str
    headline: Headline
    baseline: str = ""
    galleries: Sequence[Gallery] = ()
    figures: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Content:
    """
    Everything that a report says.

    Fields
    ------
    title, about, command : str
        Name of the study, what it is for, and the command that makes it again.
    facts : mapping of str to str
        Short facts for the head of the page.
    notes : sequence of str
    parts : sequence of Part
    rows : sequence of Row
    config : str
        The study as TOML.
    environments : sequence of mapping
        Machines and versions.
    """

    title: str
    about: str
    command: str
    facts: Mapping[str, str]
    notes: Sequence[str]
    parts: Sequence[Part]
    rows: Sequence[Row]
    config: str
    environments: Sequence[Mapping[str, str | int]]


def page(content: Content) -> str:
    """Return the page."""
    style, script = (
        (resources.files(__package__) / name).read_text("utf-8")
        for name in ("report.css", "report.js")
    )
    facts = "".join(
        f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>"
        for name, value in content.facts.items()
    )
    notes = "".join(f"<li>{escape(note)}</li>" for note in content.notes)
    about = "".join(f"<p>{escape(text)}</p>" for text in content.about.split("\n\n") if text)
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(content.title)}</title><style>{style}</style></head>
<body><header><h1>{escape(content.title)}</h1>{about}<dl class="facts">{facts}</dl>
{f'<ul class="notes">{notes}</ul>' if notes else ""}</header>
<main>{"".join(_part(part) for part in content.parts)}
<section><h2>All numbers</h2>{_numbers(content.rows)}</section>
<section><h2>How it was made</h2><pre class="command">{escape(content.command)}</pre>
{_environments(content.environments)}
<details><summary>Configuration</summary><pre>{escape(content.config)}</pre></details></section>
</main><script>{script}</script></body></html>
"""


def _part(part: Part) -> str:
    """Pictures are embedded once, in their galleries; the comparison and the crops reuse them."""
    images = next((g for g in part.galleries if g.key == "images"), None)
    compare = _compare(images, part.baseline) if images and len(images.pictures) > 1 else ""
    galleries = "".join(_gallery(gallery) for gallery in part.galleries)
    figures = "".join(
        f"<figure>{svg}<figcaption>{escape(caption)}</figcaption></figure>"
        for caption, svg in part.figures.items()
    )
    drawn = f'<h3>Figures</h3><div class="figures">{figures}</div>' if figures else ""
    return (
        f'<section class="size"><h2>{escape(part.size)}</h2>{_headline(part.headline)}'
        f"{compare}{galleries}{drawn}</section>"
    )


def _headline(table: Headline) -> str:
    if not table.headings:
        return ""
    heads = "".join(f"<th>{escape(text)}</th>" for text in table.headings)
    body = ""
    for name, cells in table.lines.items():
        body += f"<tr><th>{escape(name)}</th>"
        for cell in cells:
            if cell is None:
                body += "<td></td>"
                continue
            body += f'<td class="{cell.verdict}"><b>{escape(cell.value)}</b>'
            body += f"<small>{escape(cell.interval)}</small>" if cell.interval else ""
            body += f"<span>{escape(cell.ratio)}</span>" if cell.ratio else ""
            body += f"<i>published {escape(cell.published)}</i>" if cell.published else ""
            body += "</td>"
        body += "</tr>"
    return (
        f'<div class="wide"><table class="headline"><thead><tr><th>Variant</th>{heads}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
        '<p class="legend">Below each value its 95 % interval and the change against its baseline, '
        "run by run; coloured where the whole interval is on one side.</p>"
    )


def _compare(images: Gallery, baseline: str) -> str:
    names = list(images.pictures)
    left = baseline if baseline in names else names[0]
    right = "reference" if "reference" in names else names[-1]

    def choice(which: str, chosen: str) -> str:
        options = "".join(
            f"<option{' selected' if name == chosen else ''}>{escape(name)}</option>"
            for name in names
        )
        return f'<select class="{which}" aria-label="{which} image">{options}</select>'

    return f"""<h3>Compare</h3>
<div class="compare"><div class="choices">{choice("left", left)}
<span>drag the line · click to place the crops · wheel changes their size</span>
{choice("right", right)}</div>
<div class="stage"><canvas class="under"></canvas><canvas class="over"></canvas>
<div class="handle" role="slider" tabindex="0" aria-label="position of the line"
 aria-valuemin="0" aria-valuemax="100" aria-valuenow="50"></div><div class="frame"></div></div>
<div class="crops"></div></div>"""


def _gallery(gallery: Gallery) -> str:
    items = "".join(
        f'<figure><img data-name="{escape(name)}" alt="{escape(f"{gallery.title}: {name}")}" '
        f'src="{_uri(picture)}"><figcaption>{escape(name)}</figcaption></figure>'
        for name, picture in gallery.pictures.items()
    )
    return (
        f"<h3>{escape(gallery.title)}</h3><p>{escape(gallery.about)}</p>"
        f'<div class="gallery {gallery.key}">{items}</div>'
    )


def _uri(picture: Picture) -> str:
    return "data:image/png;base64," + base64.b64encode(encode_png(picture)).decode()


def _numbers(rows: Sequence[Row]) -> str:
    body = ""
    for row in rows:
        unit = f" {row.unit}" if row.unit else ""
        cells = (
            row.size,
            row.quantity,
            row.variant,
            f"{row.value.value:.5g}{unit}",
            ends(row.value),
            "" if row.ratio is None else percent(row.ratio),
            "" if row.p_value is None else f"{row.p_value:.2g}",
            str(row.runs),
        )
        body += "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>"
    heads = ("size", "quantity", "variant", "value", "95 % interval", "change", "p", "runs")
    head = "".join(f"<th>{name}</th>" for name in heads)
    return (
        f'<div class="wide"><table class="numbers"><thead><tr>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def _environments(environments: Sequence[Mapping[str, str | int]]) -> str:
    tables = ""
    for environment in environments:
        lines = "".join(
            f"<tr><th>{escape(name)}</th><td>{escape(str(value))}</td></tr>"
            for name, value in environment.items()
        )
        tables += f"<table>{lines}</table>"
    return f'<div class="environments">{tables}</div>'
