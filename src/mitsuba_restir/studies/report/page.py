"""The report as one HTML page that needs nothing else."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from importlib import resources

import numpy as np
from PIL import Image as Pillow

from ...imageio import encode_png
from ..config.study import REFERENCE
from ..measure.results import Row
from .colours import Picture
from .headline import Headline
from .pictures import Gallery
from .tables import breakable, environment_tables, headline_table, number_table


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
    baselines : mapping of str to str
        What each variant is compared with.
    reference : str
        How sure the reference is, and what errors leave out.
    strip : array, (H, W, 3), uint8, or None
    galleries : sequence of Gallery
    figures : mapping of str to str
        Drawings as SVG, by caption.
    """

    size: str
    headline: Headline
    baseline: str = ""
    baselines: Mapping[str, str] = field(default_factory=dict)
    reference: str = ""
    strip: Picture | None = None
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
    main = f"""{"".join(_part(part) for part in content.parts)}
<section id="numbers"><h2>All numbers</h2>{number_table(content.rows)}</section>
<section id="making"><h2>How it was made</h2><pre class="command">{escape(content.command)}</pre>
{environment_tables(content.environments)}
<details><summary>Configuration</summary><pre>{escape(content.config)}</pre></details></section>"""
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(content.title)}</title><style>{style}</style></head>
<body>{_navigation(main)}<header><h1>{escape(content.title.replace("_", " "))}</h1>{about}
<dl class="facts">{facts}</dl>{f'<ul class="notes">{notes}</ul>' if notes else ""}</header>
<main>{main}</main><script>{script}</script></body></html>
"""


def _navigation(main: str) -> str:
    """Link every heading that has an anchor."""
    found = re.findall(r'<(?:section|div) id="([^"]+)"[^>]*><h[23]>([^<]+)</h[23]>', main)
    links = "".join(f'<a href="#{anchor}">{title}</a>' for anchor, title in found)
    return f"<nav>{links}</nav>"


def _part(part: Part) -> str:
    """Pictures are embedded once, in their galleries; the comparison and the crops reuse them."""
    size = escape(part.size)
    pieces = [headline_table(part.headline, part.baselines)]
    if part.reference:
        pieces.append(f'<p class="legend">{escape(part.reference)}</p>')
    if part.strip is not None:
        pieces.append(
            _block(
                part.size, "strip", "At a glance", f'<div class="wide">{_strip(part.strip)}</div>'
            )
        )
    layers = [gallery for gallery in part.galleries if gallery.layer]
    if layers and len(layers[0].pictures) > 1:
        pieces.append(_block(part.size, "compare", "Compare", _compare(layers, part.baseline)))
    pieces += [
        _block(part.size, gallery.key, gallery.title, _gallery(gallery))
        for gallery in part.galleries
    ]
    if part.figures:
        figures = "".join(
            f"<figure>{svg}<figcaption>{escape(caption)}</figcaption></figure>"
            for caption, svg in part.figures.items()
        )
        pieces.append(
            _block(part.size, "figures", "Figures", f'<div class="figures">{figures}</div>')
        )
    return f'<section id="{size}" class="size"><h2>{size}</h2>{"".join(pieces)}</section>'


def _block(size: str, key: str, title: str, content: str) -> str:
    return f'<div id="{escape(size)}-{key}" class="block"><h3>{escape(title)}</h3>{content}</div>'


def _strip(picture: Picture) -> str:
    return f'<img class="strip" alt="frames, crops, errors and spectra" src="{_uri(picture)}">'


def _compare(layers: Sequence[Gallery], baseline: str) -> str:
    names = list(layers[0].pictures)
    left = baseline if baseline in names else names[0]
    right = REFERENCE if REFERENCE in names else names[-1]

    def choice(which: str, options: Mapping[str, str], chosen: str, label: str) -> str:
        items = "".join(
            f'<option value="{escape(key)}"{" selected" if key == chosen else ""}>{escape(text)}'
            "</option>"
            for key, text in options.items()
        )
        return f'<select class="{which}" aria-label="{label}">{items}</select>'

    variants = {name: name for name in names}
    kinds = {gallery.key: gallery.title for gallery in layers}
    return f"""<div class="compare"><div class="choices">
{choice("left", variants, left, "left image")}
{choice("layer", kinds, layers[0].key, "what is shown")}
{choice("right", variants, right, "right image")}</div>
<div class="stage"><canvas class="under"></canvas><canvas class="over"></canvas>
<div class="handle" role="slider" tabindex="0" aria-label="position of the line"
 aria-valuemin="0" aria-valuemax="100" aria-valuenow="50"></div><div class="frame"></div></div>
<p class="legend">Drag the line; click to place the crops; the wheel changes their size.</p>
<div class="crops"></div></div>"""


def _gallery(gallery: Gallery) -> str:
    items = "".join(
        f'<figure><img data-name="{escape(name)}" alt="{escape(f"{gallery.title}: {name}")}" '
        f'src="{_uri(picture)}"><figcaption>{breakable(name)}</figcaption></figure>'
        for name, picture in gallery.pictures.items()
    )
    layer = f' data-layer="{gallery.key}"' if gallery.layer else ""
    return f'<p>{escape(gallery.about)}</p><div class="gallery {gallery.key}"{layer}>{items}</div>'


def _uri(picture: Picture) -> str:
    return "data:image/png;base64," + base64.b64encode(_smallest_png(picture)).decode()


def _smallest_png(picture: Picture) -> bytes:
    """Encode maps, which have few colours, with a palette: a third of the size."""
    codes = picture.astype(np.uint32) @ np.array([1, 256, 65536], dtype=np.uint32)
    colours, index = np.unique(codes, return_inverse=True)
    if len(colours) > 256:
        return encode_png(np.ascontiguousarray(picture))
    image = Pillow.fromarray(index.reshape(picture.shape[:2]).astype(np.uint8), mode="P")
    image.putpalette(
        np.stack([colours & 255, colours >> 8 & 255, colours >> 16], axis=1).astype("u1").tobytes()
    )
    stream = io.BytesIO()
    image.save(stream, "PNG", optimize=True)
    return stream.getvalue()
