"""Folders held against other processes while something is written in them, and what killed ones left there."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from rovid.core.errors import OutputError
from rovid.core.journal import JOURNAL, PREFIX, read_journal

if TYPE_CHECKING:
    from filelock import BaseFileLock

_LOCK = f"{PREFIX}lock"
_PATIENCE = 60.0  # s; a set is written in far less
# Of file systems that know no locks; one process at a time is safe on them all the same.
_NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP)


@contextlib.contextmanager
def locked(folders: Iterable[Path]) -> Iterator[None]:
    """Keep other processes of rovid from writing in ``folders``; what killed ones left there is settled first.

    Raises
    ------
    OSError
        A folder cannot be written.
    OutputError
        Another process does not let go of one.
    """
    wanted = set(folders)
    while True:
        with contextlib.ExitStack() as stack:
            for folder in sorted(wanted):  # in one order for all, so that no two wait for each other
                stack.enter_context(_locked(folder))
            # A set that was left half done may reach into further folders.
            further = {other for folder in wanted for other in _reach(folder)} - wanted
            if not further:
                for folder in wanted:
                    _settle(folder)
                yield
                return
            wanted |= further


def recover(folder: Path) -> None:
    """Complete what a killed process left half done in ``folder``, as far as that can be written."""
    with contextlib.suppress(OSError, OutputError):
        if _reach(folder):
            with locked([folder]):
                pass


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    from filelock import FileLock, Timeout

    path = folder / _LOCK
    lock = FileLock(path, timeout=_PATIENCE, mode=0o666)
    try:
        lock.acquire()
    except Timeout as error:
        text = "is being written by another process of rovid."
        raise OutputError(text, where=folder, mend="Wait for it, and try again.") from error
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise
    try:
        yield
    finally:
        _let_go(lock, path)


def _let_go(lock: BaseFileLock, path: Path) -> None:
    # Still held: whoever waits for it takes the lock of a file that is gone for none, and makes a new one.
    with contextlib.suppress(OSError):
        path.unlink()
    lock.release()


def _left(folder: Path) -> list[Path]:
    return [Path(item.path) for item in os.scandir(folder) if item.name.startswith(PREFIX) and item.name != _LOCK]


def _reach(folder: Path) -> set[Path]:
    """Folders of the sets that were left in this one."""
    found = [read_journal(path) for path in _left(folder) if path.suffix == JOURNAL]
    return {other for one in found if one is not None for other in one.folders if other.is_dir()}


def _settle(folder: Path) -> None:
    for path in _left(folder):
        if path.suffix == JOURNAL and path.exists() and (one := read_journal(path)) is not None:
            one.settle()
    for path in _left(folder):
        path.unlink(missing_ok=True)
