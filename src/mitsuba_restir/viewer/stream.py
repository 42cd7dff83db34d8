"""The websocket of a browser: pictures out, one after each that was seen; the camera in."""

from __future__ import annotations

import asyncio
import json
import struct
import time
import uuid
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from . import camera, messages
from .camera import Pose
from .exchange import Published
from .messages import Dolly, Drag, Fly, Home, Message, Seen
from .session import Session

COMPLAINTS = 1.0
"""Seconds between two answers to what is no message."""

CLIENTS = 16
"""Browsers at once."""

BUSY = 1013
"""Code with which another one is sent away: try again later."""


def packed(published: Published) -> bytes:
    """A picture as one message: the length of its facts, the facts as JSON, and the parts."""
    sizes = [len(part) for part in published.parts]
    facts = {**published.facts, "number": published.number, "sizes": sizes}
    head = json.dumps(facts, allow_nan=False).encode()
    return struct.pack("<I", len(head)) + head + b"".join(published.parts)


class Stream:
    """
    One browser's connection.

    Parameters
    ----------
    socket : WebSocket
    session : Session
    """

    def __init__(self, socket: WebSocket, session: Session) -> None:
        self._socket, self._session = socket, session
        self._client = uuid.uuid4().hex
        self._news = asyncio.Event()
        self._sent = self._seen = 0
        self._complaint, self._complained = "", -COMPLAINTS

    async def run(self) -> None:
        """Serve until either side hangs up."""
        await self._socket.accept()
        loop = asyncio.get_running_loop()

        def tell() -> None:
            # The loop may have been closed in the meantime.
            with suppress(RuntimeError):
                loop.call_soon_threadsafe(self._news.set)

        key = self._session.enter(tell)
        self._news.set()
        tasks = [asyncio.ensure_future(work()) for work in (self._read, self._write)]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._session.leave(key, self._client)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _read(self) -> None:
        with suppress(WebSocketDisconnect):
            while True:
                received = await self._socket.receive()
                if received["type"] == "websocket.disconnect":
                    return
                self._take(received.get("text") or "")

    def _take(self, text: str) -> None:
        try:
            message = messages.parse(text)
        except ValueError as error:
            now = time.monotonic()
            if now - self._complained >= COMPLAINTS:
                self._complained, self._complaint = now, str(error)
                self._news.set()
            return
        if isinstance(message, Seen):
            self._seen = max(self._seen, message.number)
            self._news.set()
        elif isinstance(message, Home):
            self._session.go_home(self._client)
        else:
            motion = motion_of(message, self._session.speed)
            self._session.move(self._client, motion)

    async def _write(self) -> None:
        said: dict[str, Any] = {}
        with suppress(WebSocketDisconnect, RuntimeError):
            while True:
                await self._news.wait()
                self._news.clear()
                session = self._session
                note = {
                    "status": session.status,
                    "problem": session.problem,
                    "leads": session.leads(self._client),
                    "complaint": self._complaint,
                }
                if note != said:
                    said = note
                    await self._socket.send_text(json.dumps(note))
                newest = session.newest
                if newest is not None and newest.number > self._sent and self._seen >= self._sent:
                    self._sent = newest.number
                    await self._socket.send_bytes(packed(newest))


def motion_of(message: Message, speed: float) -> Callable[[Pose], Pose]:
    """
    What a message does to the camera.

    Parameters
    ----------
    message : Drag, Dolly or Fly
    speed : float
        Scene units that keys fly in a second.
    """
    if isinstance(message, Drag):
        moves = {"orbit": camera.orbit, "look": camera.look, "pan": camera.pan}
        return partial(moves[message.how], dx=message.dx, dy=message.dy)
    if isinstance(message, Dolly):
        return partial(camera.dolly, amount=message.amount)
    assert isinstance(message, Fly)
    return partial(
        camera.fly,
        right=speed * message.right,
        up=speed * message.up,
        forward=speed * message.forward,
    )
