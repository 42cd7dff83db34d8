"""The web server: pages, pictures and websockets behind the guard of :mod:`.security`."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, closing
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated

import uvicorn
from fastapi import FastAPI, Query
from nicegui import ui
from starlette.responses import PlainTextResponse, Response
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket

from ..errors import UsageError
from . import encode, page
from .command import Subject
from .logs import spare
from .security import QUERY, Guard, Policy, policy_of
from .session import Session
from .stream import BUSY, CLIENTS, Stream

PORT = 7780
"""Where the viewer is unless told otherwise, and unless something else is there."""

PATIENCE = 1
"""Seconds that connections have to end when the viewer does."""

LARGEST_MESSAGE = 1 << 16
"""Bytes of a websocket's message."""

_STATIC = Path(str(resources.files("mitsuba_restir.viewer") / "static"))


@dataclass
class Site:
    """What is served; replaced where a notebook shows another scene."""

    session: Session
    subject: Subject


def listen(host: str, port: int | None) -> socket.socket:
    """
    A socket at an address; with the port given none, the usual one or one that is free.

    Raises
    ------
    UsageError
        The address cannot be had.
    """
    error: OSError | None = None
    for candidate in (PORT, 0) if port is None else (port,):
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        server = socket.socket(family)
        server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            server.bind((host.strip("[]"), candidate))
            server.listen()
            return server
        except OSError as failed:
            server.close()
            error = failed
    assert error is not None
    raise UsageError(f"cannot listen at {host}:{port or PORT}: {error.strerror or error}")


def address_of(policy: Policy) -> str:
    """What to open in a browser, with the token where one is needed."""
    host = policy.host
    if host in ("0.0.0.0", "::"):
        host = socket.gethostname()
    elif ":" in host and not host.startswith("["):
        host = f"[{host}]"
    token = f"?{QUERY}={policy.token}" if policy.token else ""
    return f"http://{host}:{policy.port}/{token}"


class Server:
    """
    Serves a site.

    Parameters
    ----------
    site : Site
    host : str
    port : int or None
    ready : callable
        Called with the address to open, once it can be opened.

    Attributes
    ----------
    policy : Policy
        Who is served.

    Raises
    ------
    UsageError
        The address cannot be had.
    """

    def __init__(
        self, site: Site, host: str, port: int | None, ready: Callable[[str], None]
    ) -> None:
        self._socket = listen(host, port)
        self.policy = policy_of(host, self._socket.getsockname()[1])
        config = uvicorn.Config(
            Guard(_application(site, lambda: ready(address_of(self.policy))), self.policy),
            log_level="warning",
            access_log=False,
            timeout_graceful_shutdown=PATIENCE,
            ws_max_size=LARGEST_MESSAGE,
            ws_per_message_deflate=False,
        )
        self._server = uvicorn.Server(config)

    def run(self) -> None:
        """Serve until interrupted."""
        with closing(self._socket):
            self._server.run([self._socket])

    def run_in_thread(self) -> None:
        """Serve, in a thread that is not the main one, until the process ends."""
        asyncio.run(self._server.serve([self._socket]))


def _application(site: Site, ready: Callable[[], None]) -> FastAPI:
    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        spare()
        ready()
        yield

    application = FastAPI(openapi_url=None, lifespan=lifespan)
    streams: set[WebSocket] = set()

    @application.websocket("/stream")
    async def stream(websocket: WebSocket) -> None:
        if len(streams) >= CLIENTS:
            await websocket.close(BUSY)
            return
        streams.add(websocket)
        try:
            await Stream(websocket, site.session).run()
        finally:
            streams.discard(websocket)

    @application.get("/screenshot.png")
    def screenshot(divider: Annotated[float, Query(ge=0, le=1)] = 0.5) -> Response:
        newest = site.session.newest
        if newest is None:
            return PlainTextResponse("there is no picture yet\n", 503)
        pictures = newest.pictures
        shown = pictures[0]
        if len(pictures) > 1:
            shown = encode.split(shown, pictures[1], divider)
        return Response(encode.png(shown), media_type="image/png")

    application.mount("/static", StaticFiles(directory=_STATIC), name="viewer")

    @ui.page("/", title="mitsuba-restir", dark=True)
    def index() -> None:
        page.build(site.session, site.subject)

    ui.run_with(application, message_history_length=0, show_welcome_message=False, tailwind=False)
    return application
