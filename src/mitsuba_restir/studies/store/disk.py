"""On the disk: folders that one process at a time may change."""

from __future__ import annotations

from pathlib import Path

from filelock import FileLock, Timeout

from ...errors import RenderError, UsageError

LOCK = ".lock"
"""Name of the file by which a folder is locked."""


def lock_folder(folder: Path) -> FileLock:
    """
    Lock a folder until that is undone or the process ends; the file of the lock stays.

    Raises
    ------
    UsageError
        Another process holds it.
    RenderError
        The folder cannot be written to.
    """
    lock = FileLock(folder / LOCK, timeout=0)
    try:
        lock.acquire()
    except Timeout as error:
        raise UsageError(
            f"{folder} is in use by another process: wait for it, or choose another folder"
        ) from error
    except OSError as error:
        raise RenderError(f"cannot write to {folder}: {error.strerror}") from error
    return lock
