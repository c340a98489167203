"""The temporary folder of a running page. The next start removes what a killed page left behind."""

from __future__ import annotations

import contextlib
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from filelock import FileLock, Timeout

_PREFIX = "rovid-open-"
_LOCK = "lock"
# One path a line: files of unfinished uploads, which are next to the logs.
_UNFINISHED = "unfinished"
PART_PREFIX = ".rovid-upload-"
# Age in s from which a folder without a lock is stale; a starting page makes the lock at once.
_STARTED = 60.0


@dataclass(frozen=True)
class SessionFolder:
    """A folder that only this user can read, for the time of one page."""

    path: Path

    def note_unfinished(self, part: Path) -> None:
        """Note the file of an upload, which the next start deletes if this process is killed."""
        with (self.path / _UNFINISHED).open("ab") as stream:
            stream.write(os.fsencode(part) + b"\n")


@contextlib.contextmanager
def session_folder() -> Iterator[SessionFolder]:
    """A new folder, removed at the end; before that, those of killed pages are removed."""
    _remove_stale()
    path = Path(tempfile.mkdtemp(prefix=_PREFIX))  # mode 0700
    lock = FileLock(path / _LOCK)
    lock.acquire()
    try:
        yield SessionFolder(path)
    finally:
        lock.release()
        shutil.rmtree(path, ignore_errors=True)


def _remove_stale() -> None:
    for path in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*"):
        with contextlib.suppress(OSError, Timeout):
            if not _is_own_folder(path) or not ((path / _LOCK).exists() or _age(path) > _STARTED):
                continue
            with FileLock(path / _LOCK, timeout=0):
                _delete_unfinished(path / _UNFINISHED)
            shutil.rmtree(path, ignore_errors=True)


def _is_own_folder(path: Path) -> bool:
    """Whether this is a folder of this user and no link; other users may write to the folder above."""
    status = path.lstat()
    return stat.S_ISDIR(status.st_mode) and (not hasattr(os, "getuid") or status.st_uid == os.getuid())


def _age(path: Path) -> float:
    return time.time() - path.lstat().st_mtime


def _delete_unfinished(notes: Path) -> None:
    for line in notes.read_bytes().splitlines() if notes.is_file() else []:
        part = Path(os.fsdecode(line))
        if part.name.startswith(PART_PREFIX):
            part.unlink(missing_ok=True)
            # The folder goes, too, if it was made for this file.
            with contextlib.suppress(OSError):
                part.parent.rmdir()
