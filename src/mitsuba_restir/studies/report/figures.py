"""Figures for reports, notebooks and papers, with matplotlib."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...analysis.colours import line_colours
from ..measure.quantities import QUANTITIES
from ..measure.results import Row
from .curves import Curve, Lags, Radial, standard_error

if TYPE_CHECKING:
    from matplotlib.figure import Figure  # type: ignore[import-not-found, unused-ignore]

_WIDTH = 7.0

# Largest ratio of two values whose bars can be told apart.
_BARS_TO = 20.0

# Ratio of the ends of an axis from which on only decades have labels.
_LABELLED_FINELY = 2e3

Colours = Mapping[str, str]


def _axes(height: float) -> tuple[Figure, Any]:
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ImportError("Figures need matplotlib: pip install matplotlib") from error
    figure = Figure(figsize=(_WIDTH, height), layout="constrained")
    axes = figure.subplots()
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25, linewidth=0.6)
    axes.set_axisbelow(True)
    return figure, axes


def _legend(axes: Any) -> None:
    """Put the legend beside the lines, never on them."""
    axes.legend(
        loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=8, borderaxespad=0.0
    )


def _logarithmic(axis: Any) -> None:
    """Label 1, 2 and 5 of every decade, or every decade where there are many, plainly."""
    from matplotlib.ticker import LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    few = high < _LABELLED_FINELY * low
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def quantity(rows: Sequence[Row], title: str, colours: Colours | None = None) -> Figure:
    """Draw one quantity of all variants with its intervals: bars, or dots over several decades."""
    figure, axes = _axes(0.7 + 0.3 * len(rows))
    names = [row.variant for row in rows]
    chosen = line_colours(names) if colours is None else colours
    values = np.array([row.value.value for row in rows])
    ends = np.array([[row.value.low, row.value.high] for row in rows]).T
    widths = np.where(np.isfinite(ends), np.abs(ends - values), 0.0)
    draw = _dots if values.min() > 0.0 and values.max() > _BARS_TO * values.min() else _bars
    draw(axes, values, widths, [chosen[name] for name in names])
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.grid(axis="y", visible=False)
    axes.tick_params(axis="y", length=0)
    unit = f" [{rows[0].unit}]" if rows[0].unit else ""
    axes.set_xlabel(f"{title}{unit}")
    return figure


def _bars(axes: Any, values: Any, widths: Any, colours: list[str]) -> None:
    ends = {"ecolor": "#222222", "capsize": 2.5, "elinewidth": 1.0}
    axes.barh(range(len(values)), values, xerr=widths, color=colours, height=0.62, error_kw=ends)


def _dots(axes: Any, values: Any, widths: Any, colours: list[str]) -> None:
    # On a logarithmic axis, what reaches below zero has no lower end.
    below = np.minimum(widths[0], 0.95 * values)
    for y, (value, colour) in enumerate(zip(values, colours, strict=True)):
        ends = [[below[y]], [widths[1][y]]]
        axes.errorbar(value, y, xerr=ends, fmt="o", color=colour, capsize=2.5, elinewidth=1.2)
    axes.set_xscale("log")
    _logarithmic(axes.xaxis)


def _lines(
    lines: Mapping[str, tuple[Any, Any, Any]], colours: Colours, at: float | None = None
) -> tuple[Figure, Any]:
    """
    Draw lines with their intervals.

    Parameters
    ----------
    lines : mapping of str to (x, y, (low, high))
        By variant.
    at : float, optional
        Where a line across all of them is drawn.
    """
    figure, axes = _axes(3.4)
    if at is not None:
        axes.axhline(at, color="#222222", linewidth=0.8)
    for name, (x, y, ends) in lines.items():
        axes.plot(x, y, color=colours[name], label=name, linewidth=1.4)
        axes.fill_between(x, *ends, color=colours[name], alpha=0.15, linewidth=0)
    return figure, axes


def _spectral(axes: Any, label: str) -> None:
    axes.set(xscale="log", yscale="log", xlabel="frequency [cycles/pixel]", ylabel=label)
    _logarithmic(axes.xaxis)


def radial(curves: Mapping[str, Radial], colours: Colours) -> Figure:
    """Draw the power of the relative error by frequency, with its standard error over runs."""
    # On a logarithmic axis, what reaches below zero has no lower end.
    lines = {
        name: (c.frequency, p, (np.maximum(p - c.error, 0.05 * p), p + c.error))
        for name, c in curves.items()
        for p in (c.power,)
    }
    figure, axes = _lines(lines, colours)
    _spectral(axes, "power of error")
    _legend(axes)
    return figure


def radial_ratio(curves: Mapping[str, Radial], colours: Colours) -> Figure:
    """Draw the power over that of the variant's baseline, with its standard error over runs."""
    lines = {}
    for name, curve in curves.items():
        if curve.ratio is not None:
            ratio, error = curve.ratio
            lines[name] = (curve.frequency, ratio, (ratio * np.exp(-error), ratio * np.exp(error)))
    figure, axes = _lines(lines, colours, at=1.0)
    _spectral(axes, "power over baseline's")
    _logarithmic(axes.yaxis)
    _legend(axes)
    return figure


def lags(curves: Mapping[str, Lags], colours: Colours) -> Figure:
    """Draw the relative covariance of two pixels against their distance, with its error."""
    lines = {
        name: (c.distance, c.covariance, (c.covariance - c.error, c.covariance + c.error))
        for name, c in curves.items()
    }
    figure, axes = _lines(lines, colours, at=0.0)
    axes.set(xlabel="distance [pixels]", ylabel="relative covariance", xlim=(1.0, None))
    _legend(axes)
    return figure


def convergence(curves: Mapping[str, Curve], over: str, colours: Colours | None = None) -> Figure:
    """
    Draw the error of single frames (thin) and of the average so far (thick).

    Parameters
    ----------
    over : {"frames", "seconds"}
        The horizontal axis.
    """
    figure, axes = _axes(3.6)
    chosen = line_colours(curves) if colours is None else colours
    for name, curve in curves.items():
        x = curve.seconds if over == "seconds" else np.arange(1, len(curve.seconds) + 1)
        colour = chosen[name]
        mean = curve.average.mean(axis=0)
        axes.plot(x, curve.single.mean(axis=0), color=colour, linewidth=0.7, alpha=0.8)
        axes.plot(x, mean, color=colour, linewidth=1.8, label=name)
        if len(curve.average) > 1:
            error = standard_error(curve.average)
            low = np.maximum(mean - error, mean * 0.05)
            axes.fill_between(x, low, mean + error, color=colour, alpha=0.15, linewidth=0)
    label = "frames" if over == "frames" else "rendering time [s]"
    (number,) = QUANTITIES["relmse_trimmed"].numbers
    axes.set(xscale="log", yscale="log", xlabel=label, ylabel=number.name)
    _logarithmic(axes.xaxis)
    _logarithmic(axes.yaxis)
    _legend(axes)
    return figure


def encode(figure: Figure, kind: str) -> bytes:
    """Encode a figure as "svg" or "png"."""
    buffer = io.BytesIO()
    # Without a date and with fixed ids, equal figures are equal files.
    metadata = {"Date": None} if kind == "svg" else {}
    import matplotlib

    with matplotlib.rc_context({"svg.hashsalt": "mitsuba-restir", "svg.fonttype": "path"}):
        figure.savefig(buffer, format=kind, dpi=200, metadata=metadata)
    return buffer.getvalue()
