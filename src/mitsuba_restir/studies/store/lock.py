"""A lock on a folder, so that two processes do not write into it; the system frees it on a kill."""

from __future__ import annotations

from pathlib import Path

from filelock import FileLock, Timeout

from ...errors import RenderError, UsageError

FILE = ".lock"


def lock_folder(folder: Path) -> FileLock:
    """
    Lock a folder that exists until the lock is released; its file stays.

    Raises
    ------
    UsageError
        Another process holds it.
    RenderError
        The folder cannot be written to.
    """
    lock = FileLock(folder / FILE, timeout=0)
    try:
        lock.acquire()
    except Timeout as error:
        raise UsageError(
            f"{folder} is in use by another process: wait for it, or choose another folder"
        ) from error
    except OSError as error:
        raise RenderError(f"cannot write to {folder}: {error.strerror}") from error
    return lock
