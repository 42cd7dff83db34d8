"""The page: the picture's place, its tools, and dialogs. Each browser has its own."""

from __future__ import annotations

import json
from typing import Any

from nicegui import ui

from . import command
from .command import Subject
from .panel import Panel
from .session import Session, with_setting

_HEAD = """
<link rel="stylesheet" href="/static/viewer.css">
<script src="/static/viewer.js" defer></script>
"""

_STAGE = """
<div id="stage">
  <canvas id="picture" tabindex="0" aria-label="the rendered picture"></canvas>
  <div id="divider" hidden><span></span></div>
  <div id="side-a" class="tag" hidden>A</div>
  <div id="side-b" class="tag" hidden>B</div>
  <div id="busy" hidden><i></i><span></span></div>
  <div id="problem" hidden></div>
  <div id="facts"></div>
  <div id="scale"></div>
</div>
"""


def build(session: Session, subject: Subject) -> None:
    """Build the page of one browser."""
    ui.add_head_html(_HEAD)
    ui.colors(primary="#f0a04b", dark="#14161b", dark_page="#0d0f12")
    with ui.element("main").classes("viewer"):
        with ui.element("section").classes("view"):
            ui.html(_STAGE, sanitize=False).classes("frame")
            _toolbar(session, subject)
        Panel(session, subject).build()


def _toolbar(session: Session, subject: Subject) -> None:
    def button(icon: str, tip: str, **handler: Any) -> ui.button:
        made = ui.button(icon=icon, color=None).props(f'flat dense aria-label="{tip}"')
        made.on("click", **handler)
        with made:
            ui.tooltip(tip)
        return made

    def freeze() -> None:
        with_setting(session, frozen=not session.settings.frozen)

    with ui.element("div").classes("toolbar"):
        frozen = button("pause", "Freeze or go on (space)", handler=lambda _: freeze())
        frozen.props('data-control="freeze"')
        button("skip_next", "Freeze, and one frame more (.)", handler=lambda _: _step(session))
        button(
            "restart_alt", "Forget the history (backspace)", handler=lambda _: session.ask("reset")
        )
        ui.element("div").classes("gap")
        button("3d_rotation", "Orbit (o)", js_handler="() => viewer.mode('orbit')").props(
            'data-control="orbit"'
        )
        button("flight", "Fly (f)", js_handler="() => viewer.mode('fly')").props(
            'data-control="fly"'
        )
        button("home", "Camera as in the scene (h)", js_handler="() => viewer.home()")
        ui.element("div").classes("gap")
        button("photo_camera", "Save the picture (p)", js_handler="() => viewer.screenshot()")
        button(
            "terminal", "The command that renders this", handler=lambda _: _tell(session, subject)
        )
        button("fullscreen", "Whole screen", js_handler="() => viewer.fullscreen()")
        ui.element("div").classes("gap")
        button("help_outline", "Mouse and keys", handler=lambda _: _help())
    # Keys are pressed on the canvas, which has no element of NiceGUI's.
    for name, act in (
        ("freeze", freeze),
        ("step", lambda: _step(session)),
        ("reset", lambda: session.ask("reset")),
        ("compare", lambda: with_setting(session, compare=not session.settings.compare)),
    ):
        ui.on(f"viewer_{name}", lambda _, act=act: act())


def _step(session: Session) -> None:
    with_setting(session, frozen=True)
    session.ask("step")


def _tell(session: Session, subject: Subject) -> None:
    """Show the command of what is shown, and have it copied."""
    with ui.dialog() as dialog, ui.card().classes("wide"):
        ui.label("The command that renders this view").classes("title")
        if not subject.scene:
            ui.label("The scene was given as an object: there is no command that could name it.")
        for name, side in zip("AB", session.settings.shown, strict=False):
            if not subject.scene:
                break
            pose = session.pose if session.moved else None
            text = command.command(subject, side, session.full, pose)
            if session.settings.compare:
                ui.label(name).classes("side")
            ui.html(f"<pre class='command' data-side='{name}'></pre>", sanitize=False)
            ui.run_javascript(f"viewer.write('{name}', {json.dumps(text)})")
        with ui.row():
            ui.button("Copy", icon="content_copy").on("click", js_handler="() => viewer.copy()")
            ui.button("Close", on_click=dialog.close).props("flat")
    dialog.on("hide", dialog.delete)
    dialog.open()


_KEYS = (
    ("drag", "orbit around the target; in fly mode, look around"),
    ("right button or shift + drag", "move sideways"),
    ("wheel", "closer, farther"),
    ("W A S D, Q E", "fly; down, up"),
    ("shift", "three times as fast"),
    ("O, F, H", "orbit, fly, camera as in the scene"),
    ("space, .", "freeze, one frame more"),
    ("backspace", "forget the history"),
    ("C", "compare A and B; drag the line between them"),
    ("P", "save the picture"),
)


def _help() -> None:
    with ui.dialog() as dialog, ui.card():
        ui.label("Mouse and keys").classes("title")
        with ui.element("dl").classes("keys"):
            for keys, what in _KEYS:
                with ui.element("dt"):
                    ui.label(keys)
                with ui.element("dd"):
                    ui.label(what)
    dialog.on("hide", dialog.delete)
    dialog.open()
