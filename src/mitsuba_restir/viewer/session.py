"""What all pages share: settings, camera, and the newest picture. Nothing here renders.

Pages change it from the server's thread and the worker reads it from its own; whatever goes from
one to the other is replaced as a whole, under a lock.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from .camera import Pose
from .exchange import Plots, Published, Task
from .model import Settings

MOVING = 0.35
"""Seconds after a change of the camera in which it still counts as moving."""

LEASE = 10.0
"""Seconds for which a camera that is not touched stays with whoever touched it last."""


@dataclass
class _State:
    settings: Settings
    pose: Pose | None = None
    home: Pose | None = None
    resets: int = 0
    steps: int = 0
    kept: int = 0
    watchers: int = 0
    revision: int = 0
    changed: float = field(default_factory=time.monotonic)
    moved: float = -1e9
    leader: str | None = None
    led: float = -1e9


class Session:
    """
    The state of a viewer.

    Parameters
    ----------
    settings : Settings

    Attributes
    ----------
    newest : Published or None
    plots : Plots
    status : str
        What takes longer than a frame; often nothing.
    problem : str
        Why there is no new picture; often nothing.
    speed : float
        Scene units that keys fly in a second.
    full : (int, int)
        Width and height of the picture at rest [pixels].
    """

    def __init__(self, settings: Settings) -> None:
        self._state = _State(settings)
        self._wake = threading.Condition()
        self._stopped = False
        self._idle = False
        self._seen = -1
        self._listeners: dict[int, Callable[[], None]] = {}
        self.newest: Published | None = None
        self.plots = Plots()
        self.status = "loading"
        self.problem = ""
        self.speed = 1.0
        self.full = (0, 0)

    # ------------------------------ pages -----------------------------------------------------

    @property
    def settings(self) -> Settings:
        """The settings of the moment."""
        return self._state.settings

    @property
    def pose(self) -> Pose | None:
        """The camera of the moment."""
        return self._state.pose

    @property
    def moved(self) -> bool:
        """Whether the camera is elsewhere than at the beginning."""
        return self._state.pose != self._state.home

    @property
    def revision(self) -> int:
        """Grows with every change."""
        return self._state.revision

    def change(self, settings: Settings) -> None:
        """Replace the settings."""
        with self._wake:
            before = self._state.settings
            if settings != before:
                self._state.settings = settings
                self._touch(unrest=_rendered(settings) != _rendered(before))

    def move(self, client: str, motion: Callable[[Pose], Pose]) -> bool:
        """Move the camera, if the client may; whether it might."""
        with self._wake:
            state, now = self._state, time.monotonic()
            if state.pose is None or not self._may_lead(client, now):
                return False
            state.leader, state.led = client, now
            pose = motion(state.pose)
            if pose != state.pose:
                state.pose, state.moved = pose, now
                self._touch()
            return True

    def leads(self, client: str) -> bool | None:
        """Whether a client leads; None where nobody does."""
        with self._wake:
            held = time.monotonic() - self._state.led < LEASE
            return self._state.leader == client if self._state.leader and held else None

    def go_home(self, client: str) -> bool:
        """Move the camera to where it was at the beginning."""
        home = self._state.home
        return self.move(client, lambda pose: home or pose)

    def ask(self, what: str) -> None:
        """Ask for a ``reset``, a ``step``, or to ``keep`` the picture as the reference."""
        with self._wake:
            counter = {"reset": "resets", "step": "steps", "keep": "kept"}[what]
            setattr(self._state, counter, getattr(self._state, counter) + 1)
            self._touch(unrest=what != "keep")

    def enter(self, listener: Callable[[], None]) -> int:
        """Watch: the listener is called, in any thread, when there is something new to show."""
        with self._wake:
            key = max(self._listeners, default=0) + 1
            self._listeners[key] = listener
            self._state.watchers = len(self._listeners)
            self._wake.notify()
            return key

    def leave(self, key: int, client: str) -> None:
        """Watch no longer."""
        with self._wake:
            self._listeners.pop(key, None)
            self._state.watchers = len(self._listeners)
            if self._state.leader == client:
                self._state.leader = None

    def stop(self) -> None:
        """Have the worker end after the frame that it is at."""
        with self._wake:
            self._stopped = True
            self._wake.notify()

    # ------------------------------ the worker ------------------------------------------------

    def start(self, home: Pose | None) -> None:
        """The scene is there, and its camera."""
        with self._wake:
            self._state.home = home
            if self._state.pose is None or not self._state.leader:
                self._state.pose = home
            self._touch()

    def task(self) -> Task | None:
        """Wait for the next thing to do; None when there will be none."""
        with self._wake:
            while not self._stopped and not self._due():
                self._wake.wait()
            if self._stopped:
                return None
            state, now = self._state, time.monotonic()
            if self._seen != state.revision:
                self._seen, self._idle = state.revision, False
            return Task(
                state.settings,
                state.pose,
                state.resets,
                state.steps,
                state.kept,
                now - state.changed,
                now - state.moved < MOVING,
            )

    def pause(self) -> None:
        """There is nothing to do until something changes."""
        self._idle = True

    def say(self, status: str = "", problem: str | None = None) -> None:
        """Tell what takes long, and what went wrong."""
        self.status = status
        if problem is not None:
            self.problem = problem
        self._tell()

    def publish(self, published: Published) -> None:
        """Show a picture."""
        self.newest = published
        self.status = self.problem = ""
        self._tell()

    def _due(self) -> bool:
        if self._seen != self._state.revision:
            return True
        # The first picture is made for nobody: whoever comes shall not wait.
        return not self._idle and (self._state.watchers > 0 or self.newest is None)

    def _may_lead(self, client: str, now: float) -> bool:
        leader = self._state.leader
        return leader in (None, client) or now - self._state.led >= LEASE

    def _touch(self, unrest: bool = True) -> None:
        self._state.revision += 1
        if unrest:
            self._state.changed = time.monotonic()
        self._wake.notify()

    def _tell(self) -> None:
        with self._wake:
            listeners = list(self._listeners.values())
        for listener in listeners:
            listener()


def _rendered(settings: Settings) -> list[tuple[object, ...]]:
    """What frames depend on; the rest is only how they are shown."""
    return [side.rendered for side in settings.shown]


def with_setting(session: Session, **changes: Any) -> None:
    """Change some of the settings."""
    session.change(replace(session.settings, **changes))
