"""Which figures a report has, written as PNG and SVG and returned to be embedded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from ...analysis.colours import line_colours
from ..measure.quantities import NUMBERS
from ..measure.results import Measured, Row
from . import figures
from .curves import Curves

if TYPE_CHECKING:
    from matplotlib.figure import Figure  # type: ignore[import-not-found, unused-ignore]

Write = Callable[[str, bytes], None]


def draw(data: Measured, rows: Sequence[Row], found: Curves, write: Write) -> dict[str, str]:
    """
    Draw all figures of one size.

    Parameters
    ----------
    write : callable
        Called with the name and the content of every file.

    Returns
    -------
    dict of str to str
        SVG by caption, with ids that no other drawing of the report has.

    Raises
    ------
    ImportError
        Matplotlib is missing.
    """
    result = {}
    for key, (caption, figure) in _figures(data, rows, found).items():
        svg = figures.encode(figure, "svg")
        write(f"{key}.svg", svg)
        write(f"{key}.png", figures.encode(figure, "png"))
        text = svg.decode()
        unique = text[text.index("<svg") :].replace('id="', f'id="{data.size}_{key}_')
        for link in ('xlink:href="#', "url(#"):
            unique = unique.replace(link, f"{link}{data.size}_{key}_")
        result[caption] = unique
    return result


def _figures(data: Measured, rows: Sequence[Row], found: Curves) -> dict[str, tuple[str, Figure]]:
    colours = line_colours(data.runs)
    drawn = {}
    if found.radial:
        caption = "Power of the relative error by frequency: reuse leaves its blotches on the left"
        drawn["radial_spectrum"] = (caption, figures.radial(found.radial, colours))
    if any(curve.ratio is not None for curve in found.radial.values()):
        caption = "The same over the baseline's: below 1 is less noise than the baseline has there"
        drawn["radial_ratio"] = (caption, figures.radial_ratio(found.radial, colours))
    if found.lags:
        caption = "Relative covariance of two pixels by their distance, luminance clipped"
        drawn["covariance_by_distance"] = (caption, figures.lags(found.lags, colours))
    if found.convergence:
        for over in ("frames", "seconds"):
            caption = f"Error over {over}: thin, single frames; thick, the average of all so far"
            figure = figures.convergence(found.convergence, over, colours)
            drawn[f"convergence_{over}"] = (caption, figure)
    for quantity in (number.name for number in NUMBERS.values() if number.chart):
        own = [r for r in rows if r.size == data.size and r.quantity == quantity]
        if own:
            key = "".join(c if c.isalnum() else "_" for c in quantity)
            caption = f"{quantity}, with 95 % intervals"
            drawn[key] = (caption, figures.quantity(own, quantity, colours))
    return drawn
