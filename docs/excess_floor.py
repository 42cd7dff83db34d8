"""The figure of docs/decorrelation.md: large-scale error by cap, and the least that it could be.

    python docs/excess_floor.py        # writes docs/excess_floor.png

As how many frames of candidates a history counts, by its length. With the results of a study beside
it, also what is left of a frame's error behind a Gaussian of 8 pixels, measured, and its floor:

    mitsuba-restir evaluate excess -o DIR
    python docs/excess_floor.py DIR
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Mapping
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mitsuba_restir.analysis.reuse import Reuse, reach
from mitsuba_restir.passes.temporal import YOUNG

CAPS = (5, 20, 50, 100)
LENGTHS = (1, 2, 3, 5, 10, 20, 35, 50, 75, 100, 150, 200, 300, 400)
TITLE, EXCESS = "variance through 8 px, trimmed", "excess, 8 px, trimmed"

Values = Mapping[tuple[str, str], tuple[float, float, float]]
"""Value and interval by variant and quantity."""


def values_of(folder: Path) -> Values:
    """What a study has measured."""
    records = json.loads((folder / "results.json").read_text("utf-8"))
    return {
        (r["variant"], r["quantity"]): (r["value"], r["low"], r["high"])
        for r in records
        if re.match("variance through|excess", r["quantity"])
    }


def draw_frames(axes: Axes) -> None:
    """Effective frames by length of the history."""
    for cap in CAPS:
        shared = [Reuse(n, cap, 3, (20.0,), young=YOUNG) for n in LENGTHS]
        counts = [reach(reuse, (18, 32), 8.0).frames for reuse in shared]
        axes.plot(LENGTHS, counts, ".-", label=f"cap {cap}")
    axes.set(
        xlabel="frames of history",
        ylabel="effective frames",
        xscale="log",
        yscale="log",
        title="What a history counts as",
    )
    axes.legend(frameon=False)


def draw_errors(axes: Axes, values: Values) -> None:
    """Measured errors with their intervals, and the floor."""
    for mutations in (0, 1, 2, 5):
        suffix = f"_mutations_{mutations}" if mutations else ""
        found = {cap: values.get((f"cap_{cap}{suffix}", TITLE)) for cap in CAPS}
        shown = {cap: interval for cap, interval in found.items() if interval is not None}
        if not shown:
            continue
        value, low, high = zip(*shown.values(), strict=True)
        below = [v - a for v, a in zip(value, low, strict=True)]
        above = [b - v for v, b in zip(value, high, strict=True)]
        label = f"{mutations} mutations" if mutations != 1 else "1 mutation"
        axes.errorbar(list(shown), value, (below, above), capsize=3, label=label)
    floor = {cap: values[f"cap_{cap}", TITLE][0] / values[f"cap_{cap}", EXCESS][0] for cap in CAPS}
    axes.plot(list(floor), list(floor.values()), "k--", label="floor of the candidates")
    axes.set(
        xlabel="confidence_cap",
        ylabel="variance through 8 px",
        xscale="log",
        yscale="log",
        title="Large-scale error",
    )
    axes.legend(frameon=False)


def main() -> None:
    """Draw what there is."""
    studies = sys.argv[1:]
    figure = Figure(figsize=(5.5 * (1 + len(studies)), 4.2), layout="constrained")
    left, *others = figure.subplots(1, 1 + len(studies), squeeze=False)[0]
    draw_frames(left)
    for axes, folder in zip(others, studies, strict=True):
        draw_errors(axes, values_of(Path(folder)))
    figure.savefig(Path(__file__).with_suffix(".png"), dpi=110)


if __name__ == "__main__":
    main()
