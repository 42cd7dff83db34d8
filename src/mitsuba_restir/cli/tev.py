"""Shows a growing picture in a running tev, by tev's own protocol."""

from __future__ import annotations

import importlib.util
import socket
from types import TracebackType
from typing import Any

from ..errors import one_line
from ..imageio import RGB, Image
from .notes import say

PORT = 14158
"""Where tev listens unless told otherwise."""

PATIENCE = 2.0
"""Seconds after which a viewer that does not answer is given up."""


class Tev:
    """
    A connection to tev, closed at the end of its context.

    Whatever goes wrong with it is said in one line, and ends it: rendering goes on.

    Parameters
    ----------
    place : (str, int) or None
        Host and port; None shows nothing.
    name : str
        Of the picture.
    """

    def __init__(self, place: tuple[str, int] | None, name: str) -> None:
        self._place = place
        self._name = name
        self._ipc: Any = None
        self._known = False

    def __enter__(self) -> Tev:
        if self._place is None:
            return self
        if importlib.util.find_spec("tevclient") is None:
            say("--tev needs pip install 'mitsuba-restir[tev]'; rendering goes on")
            return self
        import tevclient

        self._ipc = tevclient.Ipc(*self._place)
        before = socket.getdefaulttimeout()
        # The client has no timeout of its own, and makes its socket here.
        socket.setdefaulttimeout(PATIENCE)
        try:
            self._ipc.__enter__()
        except OSError as error:
            self._give_up(error)
        finally:
            socket.setdefaulttimeout(before)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._close()

    @property
    def connected(self) -> bool:
        """Whether there is anyone to show anything to."""
        return self._ipc is not None

    def show(self, image: Image) -> None:
        """Show linear colour, (H, W, 3)."""
        if self._ipc is None:
            return
        height, width = image.shape[:2]
        try:
            if not self._known:
                self._ipc.create_image(self._name, width, height, list(RGB))
                self._known = True
            self._ipc.update_image(self._name, image, list(RGB))
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        self._close()
        assert self._place is not None
        place = f"{self._place[0]}:{self._place[1]}"
        why = error.strerror or one_line(error)
        say(f"no tev at {place} ({why}); rendering goes on")

    def _close(self) -> None:
        if self._ipc is not None:
            self._ipc.__exit__(None, None, None)
        self._ipc = None
