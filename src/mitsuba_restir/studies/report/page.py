"""The report as one HTML page that needs nothing else, from a template of Jinja."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import jinja2
import numpy as np
from PIL import Image as Pillow

from ...analysis.colours import Picture
from ...imageio import encode_png
from ..config.study import REFERENCE, Study
from ..measure.results import Row
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
        By key. Those that are layers can be compared, where they have two pictures.
    figures : mapping of str to str
        Drawings as SVG, by caption.
    """

    size: str
    headline: Headline
    baseline: str
    baselines: Mapping[str, str]
    reference: str
    strip: Picture | None
    galleries: Mapping[str, Gallery]
    figures: Mapping[str, str]

    @property
    def layers(self) -> list[Gallery]:
        """What the comparison can show; empty where there is nothing to compare."""
        found = [gallery for gallery in self.galleries.values() if gallery.layer]
        return found if found and len(found[0].pictures) > 1 else []

    @property
    def blocks(self) -> dict[str, str]:
        """Headings of what is shown under the headline, by anchor."""
        blocks = {
            "strip": "At a glance" if self.strip is not None else "",
            "compare": "Compare" if self.layers else "",
            **{key: gallery.title for key, gallery in self.galleries.items()},
            "figures": "Figures" if self.figures else "",
        }
        return {anchor: heading for anchor, heading in blocks.items() if heading}


def page(study: Study, rows: Sequence[Row], parts: Sequence[Part], **said: Any) -> str:
    """
    Return the page.

    Parameters
    ----------
    rows : sequence of Row
        All numbers.
    said : mapping of str to object
        What else the template says: `facts`, `notes`, `command`, `config` and `environments`.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader(__package__),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"uri": _uri, "ends": ends, "percent": percent}
    environment.globals |= {"reference": REFERENCE}
    groups = groupby(rows, key=lambda row: (row.size, row.quantity))
    numbers = [(*key, list(own)) for key, own in groups]
    template = environment.get_template("report.html.jinja")
    return template.render(study=study, parts=parts, numbers=numbers, **said)


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
