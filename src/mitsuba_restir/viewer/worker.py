"""The thread in which all of Mitsuba's work is done: Dr.Jit cannot record beside other work."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any

from ..errors import one_line, root
from ..imageio import Image
from .director import Director
from .exchange import Task
from .reference import Reference
from .renderer import Renderer
from .session import Session

SPEED = 0.4
"""Of flight by keys, in radii of the scene a second."""


@dataclass(frozen=True)
class Loaded:
    """
    What is to be viewed.

    Attributes
    ----------
    scene : Scene
    sensor : Sensor
    reference : array, (H, W, 3), or None
        Of the sensor's first place.
    """

    scene: Any
    sensor: Any
    reference: Image | None = None


class Worker(threading.Thread):
    """
    Renders what a session asks for.

    Parameters
    ----------
    session : Session
    load : callable
        Loads the scene; called in the thread.
    seed : int

    Attributes
    ----------
    loaded : Future
        Done when the scene is there; has the error where it cannot be loaded.
    """

    def __init__(self, session: Session, load: Callable[[], Loaded], seed: int) -> None:
        super().__init__(name="mitsuba-restir-viewer", daemon=True)
        self.loaded: Future[None] = Future()
        self._session, self._load, self._seed = session, load, seed

    def run(self) -> None:
        """Load, then render until the session is stopped."""
        session = self._session
        try:
            loaded = self._load()
            renderer = Renderer(loaded.scene, loaded.sensor, self._seed, session.say)
            session.speed, session.full = SPEED * renderer.radius, renderer.full
            session.start(renderer.home)
        except BaseException as error:
            self.loaded.set_exception(error)
            return
        self.loaded.set_result(None)
        reference = None
        if loaded.reference is not None:
            reference = Reference(loaded.reference, renderer.home, "a file")
        director = Director(renderer, reference, session.say)
        while (task := session.task()) is not None:
            self._do(director, task)
        # The scene may be somebody else's.
        renderer.place(renderer.home, renderer.full)

    def _do(self, director: Director, task: Task) -> None:
        session = self._session
        try:
            published = director.picture(task)
        except Exception as error:
            # Whatever a frame fails of is said in the page; the next change may mend it.
            if not isinstance(error, ValueError | RuntimeError):
                traceback.print_exc()
            session.pause()
            session.say(problem=one_line(root(error)) or type(error).__name__)
            return
        if published is not None:
            session.plots = director.plots
            session.publish(published)
        if director.done:
            session.pause()
