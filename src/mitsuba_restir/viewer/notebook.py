"""The viewer in a notebook: the page in an IFrame, served by a thread of the notebook's process."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from concurrent.futures import Future
from html import escape

import mitsuba as mi

from ..integrators.declaration import Value
from .command import Subject
from .model import Settings, Side, with_parameter
from .server import Server, Site
from .session import Session
from .worker import Loaded, Worker

STARTED = 20.0
"""Seconds that the server may take to start."""

ENDED = 10.0
"""Seconds that the last frame may take."""


class Viewer:
    """
    A scene that is shown. In a notebook it is displayed as an IFrame.

    Frames are rendered while somebody looks, in a thread: do nothing else with Mitsuba meanwhile,
    or freeze the viewer, or close it. There is one viewer at a time, and the sensor is where it
    was when the viewer has been closed.

    Attributes
    ----------
    url : str
        The page, for a browser on the same machine.
    """

    def __init__(self, session: Session, worker: Worker, url: str, height: int) -> None:
        self.url = url
        self._session, self._worker, self._height = session, worker, height

    def close(self) -> None:
        """Render no more; give the scene back."""
        self._session.stop()
        self._worker.join(ENDED)

    def _repr_html_(self) -> str:
        return (
            f'<iframe src="{escape(self.url)}" width="100%" height="{self._height}" '
            'style="border: 0" allow="fullscreen; clipboard-write"></iframe>'
        )

    def __repr__(self) -> str:
        return f"Viewer({self.url})"


class _Running:
    """The one server of the process, and what it shows: NiceGUI's pages are the process's own."""

    def __init__(self) -> None:
        self.viewer: Viewer | None = None
        self._site: Site | None = None
        self._url = ""

    def serve(self, session: Session, subject: Subject) -> str:
        """Show a session; the address of the page."""
        if self._site is not None:
            self._site.session, self._site.subject = session, subject
            return self._url
        site = Site(session, subject)
        ready: Future[str] = Future()
        server = Server(site, "127.0.0.1", None, ready.set_result)
        threading.Thread(target=server.run_in_thread, daemon=True).start()
        self._url = ready.result(STARTED)
        self._site = site
        return self._url


_RUNNING = _Running()


def view(
    scene: mi.Scene,
    sensor: int | mi.Sensor = 0,
    spp: int = 1,
    height: int = 720,
    seed: int = 0,
    **parameters: Value,
) -> Viewer:
    """
    Show a scene live.

    Parameters
    ----------
    scene : Scene
    sensor : int or Sensor
        It is moved and its film resized while the viewer is open.
    spp : int
        Candidate paths per pixel and frame.
    height : int
        Of the IFrame [pixels].
    seed : int
    **parameters
        Of ``restir_pt``.

    Returns
    -------
    Viewer

    Raises
    ------
    ValueError
        A parameter is not allowed.
    """
    side = _side(parameters, spp)
    camera = scene.sensors()[sensor] if isinstance(sensor, int) else sensor
    if _RUNNING.viewer is not None:
        _RUNNING.viewer.close()
    session = Session(Settings((side, side)))
    worker = Worker(session, lambda: Loaded(scene, camera), seed)
    worker.start()
    worker.loaded.result()
    _RUNNING.viewer = Viewer(session, worker, _RUNNING.serve(session, Subject("", "scene")), height)
    return _RUNNING.viewer


def _side(parameters: Mapping[str, Value], spp: int) -> Side:
    side = Side(spp=spp)
    # Choosing a preset forgets what has been set before.
    for name in sorted(parameters, key=lambda name: name != "preset"):
        side = with_parameter(side, name, parameters[name])
    return side
