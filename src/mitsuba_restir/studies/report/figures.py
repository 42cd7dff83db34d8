"""Figures for reports, notebooks and papers, with matplotlib."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ...analysis import spectrum
from ..results import Row
from .curves import Curve

if TYPE_CHECKING:
    from matplotlib.figure import Figure  # type: ignore[import-not-found, unused-ignore]

_WIDTH = 7.0
_COLOURS = (
    "#4c566a", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8c564b",
    "#7f7f7f", "#b8a800",
)  # fmt: skip


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
    axes.set_prop_cycle(color=_COLOURS)
    return figure, axes


def bars(rows: Sequence[Row], title: str) -> Figure:
    """Draw one quantity as a bar for each variant, with its interval."""
    figure, axes = _axes(0.7 + 0.34 * len(rows))
    names = [row.variant for row in rows]
    values = np.array([row.value.value for row in rows])
    ends = np.array([[row.value.low, row.value.high] for row in rows]).T
    widths = np.where(np.isfinite(ends), np.abs(ends - values), 0.0)
    colours = [_COLOURS[i % len(_COLOURS)] for i in range(len(rows))]
    axes.barh(names, values, xerr=widths, color=colours, height=0.62, capsize=3, ecolor="#222222")
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)
    unit = f" [{rows[0].unit}]" if rows[0].unit else ""
    axes.set_xlabel(f"{title}{unit}")
    return figure


def radial(powers: dict[str, npt.NDArray[np.float64]]) -> Figure:
    """Draw the power of the relative error against the frequency, mean over directions."""
    figure, axes = _axes(3.4)
    for name, power in powers.items():
        found = spectrum.radial_spectrum(power)
        axes.plot(found.frequency, found.power, label=name, linewidth=1.4)
    axes.set(xscale="log", yscale="log", xlabel="frequency [cycles/pixel]", ylabel="power of error")
    axes.legend(frameon=False, fontsize=8)
    return figure


def convergence(curves: dict[str, Curve], over: str) -> Figure:
    """
    Draw the error of single frames (thin) and of the average so far (thick).

    Parameters
    ----------
    over : {"frames", "seconds"}
        The horizontal axis.
    """
    figure, axes = _axes(3.6)
    for index, (name, curve) in enumerate(curves.items()):
        x = curve.seconds if over == "seconds" else np.arange(1, len(curve.seconds) + 1)
        colour = _COLOURS[index % len(_COLOURS)]
        mean = curve.average.mean(axis=0)
        axes.plot(x, curve.single.mean(axis=0), color=colour, linewidth=0.7, alpha=0.8)
        axes.plot(x, mean, color=colour, linewidth=1.8, label=name)
        if len(curve.average) > 1:
            error = curve.average.std(axis=0, ddof=1) / np.sqrt(len(curve.average))
            low = np.maximum(mean - error, mean * 0.05)
            axes.fill_between(x, low, mean + error, color=colour, alpha=0.15, linewidth=0)
    label = "frames" if over == "frames" else "rendering time [s]"
    axes.set(xscale="log", yscale="log", xlabel=label, ylabel="relMSE, trimmed")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter("" if over == "frames" else "{x:.2g}")
    axes.legend(frameon=False, fontsize=8)
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
