"""A lock on a folder, so that two processes do not write into it; the system frees it on a kill."""

from __future__ import annotations

import os
from pathlib import Path

from ...errors import RenderError, UsageError

FILE = ".lock"


class FolderLock:
    """
    An exclusive lock on a folder that exists.

    Parameters
    ----------
    folder : Path

    Raises
    ------
    UsageError
        Another process holds it.
    RenderError
        The folder cannot be written to.
    """

    def __init__(self, folder: Path) -> None:
        try:
            self._handle = os.open(folder / FILE, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError as error:
            raise RenderError(f"cannot write to {folder}: {error.strerror}") from error
        try:
            _lock(self._handle)
        except OSError as error:
            os.close(self._handle)
            raise UsageError(
                f"{folder} is in use by another process: wait for it, or choose another folder"
            ) from error

    def release(self) -> None:
        """Give the folder free; the file stays, since another process may already wait for it."""
        os.close(self._handle)


def _lock(handle: int) -> None:
    try:
        import fcntl
    except ImportError:
        import msvcrt

        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
    else:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
