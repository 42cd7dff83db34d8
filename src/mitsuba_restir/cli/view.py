"""``mitsuba-restir view``: a scene in a browser, rendered live."""

from __future__ import annotations

import argparse
import importlib.util
import os
import webbrowser
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import UsageError
from ..imageio import read_rgb
from ..viewer.command import Subject
from ..viewer.model import Settings, Side
from ..viewer.session import Session
from ..viewer.worker import Loaded, Worker
from . import loading
from .arguments import as_dict, integer, positive
from .notes import say
from .parameters import parse_parameters
from .render import add_scene_arguments, add_spp_argument
from .signals import INTERRUPTED, TERMINATED, Terminated

SCENE = "ajar"
FPS = 15.0

PATIENCE = 0.7
"""Seconds that the last frame has to end."""


def add_command(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "view",
        help="see a scene live, in a browser",
        description="Render a scene live with restir_pt, and show it in a browser.",
    )
    add_scene_arguments(parser, SCENE)
    add_spp_argument(parser)
    parser.add_argument(
        "--fps",
        metavar="N",
        type=_fps,
        default=FPS,
        help=f"frames a second to hold while the camera moves, by fewer pixels ({FPS:g}; 0: all "
        "pixels always)",
    )
    parser.add_argument(
        "--reference",
        metavar="FILE",
        type=Path,
        help="an image of the scene to show errors against",
    )
    parser.add_argument(
        "--host",
        metavar="HOST",
        default="127.0.0.1",
        help="address to listen at (127.0.0.1, this machine only; others need the token that is "
        "printed)",
    )
    parser.add_argument(
        "--port", metavar="N", type=integer(1, 2**16 - 1), help="port (7780, or one that is free)"
    )
    parser.add_argument("--open", action="store_true", help="open it in the browser")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Serve until interrupted."""
    parameters = parse_parameters(as_dict(options.parameters, "-p"))
    definitions = as_dict(options.definitions, "-D")
    if importlib.util.find_spec("nicegui") is None:
        raise UsageError("view needs pip install 'mitsuba-restir[view]'")

    def load() -> Loaded:
        loading.choose_variant(options.variant)
        loading.make_integrator("restir_pt", parameters)
        scene = loading.load_scene(options.scene, definitions, options.resolution)
        sensor = loading.choose_sensor(scene, options.sensor)
        return Loaded(scene, sensor, _reference(options.reference, sensor))

    def ready(address: str) -> None:
        print(f"viewer at {address} (Ctrl-C ends it)", flush=True)
        if options.open:
            webbrowser.open(address)

    side = Side(parameters, options.spp)
    session = Session(Settings((side, side), fps=options.fps))
    worker = Worker(session, load, options.seed)
    worker.start()
    try:
        # Meanwhile: it takes as long as to load the scene.
        from ..viewer import server

        site = server.Site(session, _subject(options, definitions))
        worker.loaded.result()
        server.Server(site, options.host, options.port, ready).run()
    except KeyboardInterrupt as interrupt:
        _end(session, worker)
        if worker.is_alive():
            # It compiles a kernel, for which Python would wait.
            terminated = isinstance(interrupt, Terminated)
            say("terminated" if terminated else "interrupted")
            os._exit(TERMINATED if terminated else INTERRUPTED)
        raise
    finally:
        _end(session, worker)
    return 0


def _end(session: Session, worker: Worker) -> None:
    session.stop()
    worker.join(PATIENCE)


def _subject(options: argparse.Namespace, definitions: Mapping[str, str]) -> Subject:
    title = Path(options.scene).parent.name if options.scene.endswith(".xml") else options.scene
    return Subject(
        options.scene,
        title or options.scene,
        definitions,
        options.variant,
        options.sensor,
        options.seed,
    )


def _fps(text: str) -> float:
    return 0.0 if text.strip() == "0" else positive(text)


def _reference(path: Path | None, sensor: Any) -> Any:
    if path is None:
        return None
    image = read_rgb(path)
    width, height = sensor.film().crop_size()
    if image.shape[:2] != (height, width):
        raise UsageError(
            f"argument --reference: {path} has {image.shape[1]}x{image.shape[0]} pixels, the "
            f"picture {width}x{height}"
        )
    return image
