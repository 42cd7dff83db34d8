"""The charts at the side of the picture."""

from __future__ import annotations

from nicegui import ui

from . import plots
from .session import Session

PLOTTED = 1.0
"""Seconds between two sets of plots."""


def build(session: Session) -> None:
    """Build the charts of one browser; what is folded away is not drawn."""
    with ui.expansion("Time by pass", value=True).classes("group plots").props("dense") as times:
        passes = ui.echart(plots.passes(())).classes("plot").props('data-control="passes"')
    with ui.expansion("Power spectrum of the error").classes("group plots").props("dense") as s:
        spectrum = ui.echart(plots.spectra(())).classes("plot").props('data-control="spectrum"')
        note = ui.label("Needs a reference of this view: let it rest, then keep it.")
        note.classes("note")

    def draw() -> None:
        shown = session.plots
        note.set_visibility(not any(shown.spectra))
        for part, chart, options in (
            (times, passes, plots.passes(shown.passes)),
            (s, spectrum, plots.spectra(shown.spectra)),
        ):
            if part.value and chart.options != options:
                chart.options.clear()
                chart.options.update(options)
                chart.update()

    ui.timer(PLOTTED, draw)
