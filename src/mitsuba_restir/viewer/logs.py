"""What libraries of the server complain of: a line, and not one for each of a thousand messages."""

from __future__ import annotations

import asyncio
import logging
import sys
import time
from typing import Any

from ..errors import one_line

SPACING = 1.0
"""Seconds between two lines."""

_TALKATIVE = ("engineio.server", "socketio.server", "nicegui")
"""Loggers that write the traceback of every message that is none."""


class Sparing(logging.Handler):
    """Writes a line of a record, and leaves out those that come too soon after."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._last = -SPACING

    def emit(self, record: logging.LogRecord) -> None:
        """Write a record's line, or nothing."""
        now = time.monotonic()
        if now - self._last < SPACING:
            return
        self._last = now
        error = record.exc_info[1] if record.exc_info else None
        why = f": {one_line(error)}" if error is not None else ""
        print(f"viewer: {one_line(record.getMessage())}{why}", file=sys.stderr)


def spare() -> None:
    """Have the server's libraries, and the loop that this runs in, say little."""
    handler = Sparing()
    for name in _TALKATIVE:
        logger = logging.getLogger(name)
        logger.handlers = [handler]
        logger.propagate = False
    told = logging.getLogger(_TALKATIVE[0])

    def complain(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        told.error(context["message"], exc_info=context.get("exception"))

    asyncio.get_running_loop().set_exception_handler(complain)
