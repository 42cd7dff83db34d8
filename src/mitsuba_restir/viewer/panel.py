"""The panel at the side of the picture: settings, parameters, plots."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from nicegui import ui

from ..integrators.presets import PRESETS
from . import charts, controls
from .command import Subject
from .controls import Control
from .model import Settings, Side, with_parameter
from .session import Session, with_setting
from .views import VIEWS

REFRESH = 0.2
"""Seconds between two looks at what others have changed."""


class Panel:
    """
    The controls at the side of the picture.

    Parameters
    ----------
    session : Session
    subject : Subject
    """

    def __init__(self, session: Session, subject: Subject) -> None:
        self._session, self._subject = session, subject
        self._edited = 0
        self._revision = -1
        self._refreshers: list[Callable[[Settings, Side], object]] = []

    def build(self) -> None:
        """Build it."""
        with ui.element("aside").classes("panel"):
            with ui.element("header"):
                ui.label("mitsuba-restir").classes("brand")
                ui.label(self._subject.title).classes("scene")
            self._picture()
            self._sides()
            self._parameters()
            charts.build(self._session)
        self._refresh()
        ui.timer(REFRESH, self._refresh)

    # ------------------------------ parts -----------------------------------------------------

    def _picture(self) -> None:
        with ui.element("div").classes("group"):
            self._slider(
                "Exposure", (-6, 6, 0.25), lambda s: s.exposure, lambda v: {"exposure": v}, "stops"
            )
            self._slider(
                "Frames a second while moving",
                (0, 60, 1),
                lambda s: s.fps,
                lambda v: {"fps": v},
                "0: all pixels always",
            )
            self._switch(
                "Accumulate at rest",
                lambda s: s.accumulate,
                lambda v: {"accumulate": v},
                "The picture becomes the mean of independent frames when the camera rests.",
            )
            with ui.element("div").classes("line"):
                ui.label("Reference").classes("name")
                ui.button("Keep this still", on_click=self._keep).props(
                    'flat dense no-caps data-control="keep"'
                ).tooltip("Errors and spectra are of this view against it.")

    def _sides(self) -> None:
        with ui.element("div").classes("group"):
            self._switch(
                "Compare A and B",
                lambda s: s.compare,
                lambda v: {"compare": v},
                "Two configurations of the same sequence of frames.",
            )
            tabs = ui.toggle({0: "A", 1: "B"}, value=0, on_change=lambda e: self._edit(e.value))
            tabs.classes("sides").props("spread dense no-caps unelevated")
            self._refreshers.append(lambda s, side: tabs.set_visibility(s.compare))
            views = {name: view.title for name, view in VIEWS.items()}
            self._select(
                "View", views, lambda side: side.view, lambda side, v: replace(side, view=v)
            )
            presets = {name: name for name in PRESETS}
            self._select(
                "Preset",
                presets,
                lambda side: side.value("preset"),
                lambda side, v: with_parameter(side, "preset", v),
            )

    def _parameters(self) -> None:
        groups = controls.grouped()
        for index, (group, found) in enumerate(groups.items()):
            with ui.expansion(group, value=index == 0).classes("group").props("dense"):
                if group == "Candidates":
                    self._number("Candidates a pixel (spp)", 1, 4096, _spp, _with_spp)
                for control in found:
                    self._control(control)

    # ------------------------------ controls --------------------------------------------------

    def _control(self, control: Control) -> None:
        name = control.parameter.name

        def read(side: Side) -> Any:
            return side.value(name)

        def write(side: Side, value: Any) -> Side:
            return with_parameter(side, name, value)

        parameter = control.parameter
        if control.kind == "select":
            options = {choice: choice.replace("_", " ") for choice in parameter.choices}
            self._select(control.title, options, read, write, control.help)
        elif control.kind == "number":
            self._number(
                control.title, parameter.low, parameter.high, read, write, help=control.help
            )
        elif control.kind == "slider":
            self._parameter_slider(control, read, write)
        else:
            with self._line(control.title, control.help):
                made = ui.switch(on_change=lambda e: self._set(lambda s: write(s, bool(e.value))))
                made.props(f'dense data-control="{name}"')
            self._refreshers.append(lambda _, side: made.set_value(read(side)))

    def _parameter_slider(
        self,
        control: Control,
        read: Callable[[Side], Any],
        write: Callable[[Side, Any], Side],
    ) -> None:
        low, high, step = control.positions
        with self._line(control.title, control.help):
            shown = ui.label().classes("value")
        made = ui.slider(min=low, max=high, step=step)
        made.props(f'dense data-control="{control.parameter.name}"')
        made.on_value_change(lambda e: shown.set_text(f"{control.value(e.value):g}"))
        # Once it is let go: each value makes another integrator.
        made.on("change", lambda e: self._set(lambda s: write(s, control.value(float(e.args)))))
        self._refreshers.append(lambda _, side: made.set_value(control.position(read(side))))

    def _number(
        self,
        title: str,
        low: float,
        high: float,
        read: Callable[[Side], Any],
        write: Callable[[Side, Any], Side],
        help: str = "",
    ) -> None:
        def take(value: Any) -> None:
            kind = type(read(self._side))
            if value is not None:
                self._set(lambda side: write(side, kind(min(max(value, low), high))))

        with self._line(title, help):
            made = ui.number(min=low, max=high).props("dense outlined hide-bottom-space")
        made.on("change", lambda: take(made.value))
        self._refreshers.append(lambda _, side: made.set_value(read(side)))

    def _select(
        self,
        title: str,
        options: dict[str, str],
        read: Callable[[Side], Any],
        write: Callable[[Side, Any], Side],
        help: str = "",
    ) -> None:
        with self._line(title, help):
            made = ui.select(
                options,
                value=read(self._side),
                on_change=lambda e: self._set(lambda side: write(side, e.value)),
            )
            made.props(f'dense outlined options-dense data-control="{title.lower()}"')
        self._refreshers.append(lambda _, side: made.set_value(read(side)))

    def _slider(
        self,
        title: str,
        steps: tuple[float, float, float],
        read: Callable[[Settings], float],
        changes: Callable[[float], dict[str, Any]],
        unit: str,
    ) -> None:
        low, high, step = steps
        with self._line(title, unit):
            shown = ui.label().classes("value")
        made = ui.slider(min=low, max=high, step=step, value=read(self._session.settings))
        made.props(f'dense data-control="{title.split()[0].lower()}"')

        def take(value: float) -> None:
            shown.set_text(f"{value:g}")
            with_setting(self._session, **changes(float(value)))

        made.on_value_change(lambda e: take(e.value))
        self._refreshers.append(
            lambda s, _: (made.set_value(read(s)), shown.set_text(f"{read(s):g}"))
        )

    def _switch(
        self,
        title: str,
        read: Callable[[Settings], bool],
        changes: Callable[[bool], dict[str, Any]],
        help: str,
    ) -> None:
        with self._line(title, help):
            made = ui.switch(
                value=read(self._session.settings),
                on_change=lambda e: with_setting(self._session, **changes(bool(e.value))),
            )
            made.props(f'dense data-control="{title.split()[0].lower()}"')
        self._refreshers.append(lambda s, _: made.set_value(read(s)))

    def _line(self, title: str, help: str) -> ui.element:
        line = ui.element("div").classes("line")
        with line:
            label = ui.label(title).classes("name")
            if help:
                with label:
                    ui.tooltip(help).props(
                        "max-width=320px anchor='center left' self='center right'"
                    )
        return line

    # ------------------------------ state -----------------------------------------------------

    def _keep(self) -> None:
        newest = self._session.newest
        if newest is None or newest.facts["state"] != "still":
            ui.notify("There is no still yet: let the camera rest.", type="warning")
            return
        self._session.ask("keep")
        ui.notify(f"Kept as the reference: {newest.facts['frames']} frames or more.")

    @property
    def _side(self) -> Side:
        return self._session.settings.sides[self._edited]

    def _edit(self, index: int) -> None:
        self._edited = index
        self._revision = -1
        self._refresh()

    def _set(self, change: Callable[[Side], Side]) -> None:
        """Change the side that is edited; what it refuses is said."""
        settings = self._session.settings
        try:
            side = change(self._side)
        except ValueError as error:
            ui.notify(str(error), type="negative")
            self._revision = -1
            return
        self._session.change(settings.with_side(self._edited, side))

    def _refresh(self) -> None:
        """Show what has been changed, here or in another browser."""
        revision = self._session.revision
        if revision == self._revision:
            return
        self._revision = revision
        settings = self._session.settings
        if not settings.compare:
            self._edited = 0
        for refresh in self._refreshers:
            refresh(settings, settings.sides[self._edited])


def _spp(side: Side) -> int:
    return side.spp


def _with_spp(side: Side, spp: int) -> Side:
    return replace(side, spp=spp)
