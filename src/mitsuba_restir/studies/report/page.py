"""The report as one HTML page that needs nothing else, from a template of Jinja."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby

import jinja2
import numpy as np
from PIL import Image as Pillow

from ...imageio import encode_png
from ..config.study import REFERENCE
from ..measure.results import Row
from .colours import Picture
from .headline import Headline, ends, percent
from .pictures import Gallery


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
    galleries : mapping of str to Gallery
        By key.
    figures : mapping of str to str
        Drawings as SVG, by caption.
    """

    size: str
    headline: Headline
    baseline: str = ""
    baselines: Mapping[str, str] = field(default_factory=dict)
    reference: str = ""
    strip: Picture | None = None
    galleries: Mapping[str, Gallery] = field(default_factory=dict)
    figures: Mapping[str, str] = field(default_factory=dict)

    @property
    def layers(self) -> dict[str, Gallery]:
        """What the comparison can show, by key; its pictures are those of the galleries."""
        return {key: gallery for key, gallery in self.galleries.items() if gallery.layer}

    @property
    def compared(self) -> list[str]:
        """Names that the comparison chooses from; fewer than two are not compared."""
        return list(next((gallery.pictures for gallery in self.layers.values()), ()))

    @property
    def left(self) -> str:
        """What the comparison begins with on its left."""
        return self.baseline if self.baseline in self.compared else self.compared[0]

    @property
    def right(self) -> str:
        """What the comparison begins with on its right."""
        return REFERENCE if REFERENCE in self.compared else self.compared[-1]

    @property
    def blocks(self) -> dict[str, str]:
        """Headings of what is shown under the headline, by anchor."""
        compare = len(self.compared) > 1
        return {
            **({"strip": "At a glance"} if self.strip is not None else {}),
            **({"compare": "Compare"} if compare else {}),
            **{key: gallery.title for key, gallery in self.galleries.items()},
            **({"figures": "Figures"} if self.figures else {}),
        }


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

    @property
    def numbers(self) -> list[tuple[tuple[str, str], list[Row]]]:
        """Rows that follow each other, by size and quantity."""
        groups = groupby(self.rows, key=lambda row: (row.size, row.quantity))
        return [(key, list(rows)) for key, rows in groups]


def page(content: Content) -> str:
    """Return the page."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader(__package__),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"uri": _uri, "ends": ends, "percent": percent}
    return environment.get_template("report.html.jinja").render(report=content)


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
