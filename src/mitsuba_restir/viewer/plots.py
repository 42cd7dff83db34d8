"""What is plotted beside the picture, as options of ECharts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..analysis.colours import line_colours

_SIDES = ("A", "B")
_TEXT = "#9aa3b2"
_GRID = {"left": 8, "right": 20, "top": 24, "bottom": 22, "containLabel": True}
_PASSES = (
    "camera rays",
    "candidates",
    "temporal reuse",
    "learning",
    "mutations",
    "spatial reuse",
    "shading",
    "film",
    "frame",
)


def passes(sides: Sequence[Mapping[str, float]]) -> dict[str, Any]:
    """
    Bars of the time by pass.

    Parameters
    ----------
    sides : sequence of mappings of str to float
        Milliseconds by pass, of A, and of B where they are compared.
    """
    shown = [name for name in _PASSES if any(name in side for side in sides)]
    colours = line_colours(_PASSES)
    return {
        **_common(),
        "tooltip": {"trigger": "axis", "axisPointer": {"type": "shadow"}},
        "grid": {**_GRID, "top": 58},
        "xAxis": {"type": "value", "name": "ms", **_axis()},
        "yAxis": {"type": "category", "data": list(_SIDES[: len(sides)])[::-1], **_axis()},
        "series": [
            {
                "name": name,
                "type": "bar",
                "stack": "frame",
                "barMaxWidth": 26,
                "itemStyle": {"color": colours[name]},
                "data": [round(side.get(name, 0.0), 2) for side in reversed(sides)],
            }
            for name in shown
        ],
    }


def spectra(sides: Sequence[Sequence[tuple[float, float]]]) -> dict[str, Any]:
    """
    Lines of the power of errors by frequency.

    Parameters
    ----------
    sides : sequence of sequences of (float, float)
        Frequency [cycles/pixel] and power, of A, and of B where they are compared.
    """
    return {
        **_common(),
        "tooltip": {"trigger": "axis"},
        "grid": _GRID,
        "xAxis": {"type": "value", "min": 0, "max": 0.5, **_axis(), "name": "cycles/pixel"},
        "yAxis": {"type": "log", **_axis(), "scale": True},
        "series": [
            {
                "name": name,
                "type": "line",
                "showSymbol": False,
                "lineStyle": {"width": 2, "color": colour},
                "itemStyle": {"color": colour},
                "data": [[round(f, 4), float(f"{p:.3g}")] for f, p in side if p > 0],
            }
            for name, colour, side in zip(_SIDES, ("#f0a04b", "#56b4e9"), sides, strict=False)
        ],
    }


def _common() -> dict[str, Any]:
    return {
        "animation": False,
        "textStyle": {"color": _TEXT},
        "legend": {"top": 0, "textStyle": {"color": _TEXT}, "itemWidth": 10, "itemHeight": 10},
    }


def _axis() -> dict[str, Any]:
    return {
        "nameLocation": "middle",
        "nameGap": 20,
        "axisLabel": {"color": _TEXT, "hideOverlap": True},
        "axisLine": {"lineStyle": {"color": "#39404d"}},
        "splitLine": {"lineStyle": {"color": "#262b35"}},
    }
