"""Sets of files that are replaced together, under a lock on each of their folders.

A set is written in four steps:

1. A journal file in each folder of the set lists the staged files, their targets and the stale files.
2. The new files are staged next to their targets and synced to the disk.
3. One commit file is created. The set counts as written from here on.
4. The staged files are renamed to their targets. Stale files, the commit file and the journals are deleted.

A process that is killed in step 4 leaves old and new files side by side. The next rovid that comes to one of the
folders calls `recover`: with a commit file it repeats step 4, without one it deletes the staged files.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import secrets
import signal
import stat
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rovid.core.errors import OutputError

_PREFIX = ".rovid-"
_LOCK = f"{_PREFIX}lock"
_JOURNAL_SUFFIX = ".journal"
# s; writing a set takes far less.
_LOCK_TIMEOUT = 60.0
# Error numbers of file systems without locks. One rovid process at a time is safe on them without a lock.
_NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP)


@dataclass(frozen=True, kw_only=True)
class _Transaction:
    """What replaces a set of files."""

    journals: tuple[Path, ...]  #: Path of the journal in each folder of the set.
    commit: Path  #: Path of the commit file.
    moves: tuple[tuple[Path, Path], ...]  #: (staged file, target) of each new file.
    #: (stale file, its inode). A file with another inode was written since, and stays.
    removals: tuple[tuple[Path, int], ...]

    def write_journals(self) -> None:
        """Write the journals. Paths in a journal are relative to its folder, which may be moved."""
        for journal in self.journals:

            def relative(path: Path, folder: Path = journal.parent) -> str:
                return os.path.relpath(path, folder)

            document = {
                "journals": [relative(path) for path in self.journals],
                "commit": relative(self.commit),
                "moves": [[relative(staged), relative(target)] for staged, target in self.moves],
                "removals": [[relative(path), inode] for path, inode in self.removals],
            }
            write_synced(journal, json.dumps(document).encode())

    def finish(self) -> None:
        """Rename staged files that are still there to their targets, and delete stale files."""
        for staged, target in self.moves:
            try:
                os.replace(staged, target)  # noqa: PTH105 - the tests kill the process at each of these calls
            except FileNotFoundError:
                if staged.exists():
                    raise
        for path, inode in self.removals:
            with contextlib.suppress(FileNotFoundError):
                if path.stat().st_ino == inode:
                    path.unlink()

    def clean_up(self) -> None:
        """Delete commit file, staged files and journals. The commit file goes first: without it nothing is moved."""
        for path in (self.commit, *(staged for staged, _ in self.moves), *self.journals):
            path.unlink(missing_ok=True)


def _read_journal(path: Path) -> _Transaction | None:
    """The transaction in a journal; None if the journal is incomplete, in which case nothing was staged."""

    def absolute(place: str) -> Path:
        return Path(os.path.normpath(path.parent / place))

    try:
        document = json.loads(path.read_bytes())
        return _Transaction(
            journals=tuple(map(absolute, document["journals"])),
            commit=absolute(document["commit"]),
            moves=tuple((absolute(staged), absolute(target)) for staged, target in document["moves"]),
            removals=tuple((absolute(place), int(inode)) for place, inode in document["removals"]),
        )
    except (ValueError, KeyError, TypeError):
        return None


def replace_files(contents: Mapping[Path, bytes], stale: Sequence[Path], folders: Sequence[Path]) -> None:
    """Write all ``contents`` and delete all ``stale`` files, or change nothing.

    The caller holds the locks of ``folders``, which are the folders of all these files. A single file needs no journal.

    Raises
    ------
    OSError
        A file cannot be written. Nothing was changed.
    """
    name = _PREFIX + secrets.token_hex(8)
    transaction = _Transaction(
        journals=tuple(folder / (name + _JOURNAL_SUFFIX) for folder in folders),
        commit=folders[0] / f"{name}.commit",
        moves=tuple((target.parent / f"{_PREFIX}{secrets.token_hex(8)}.tmp", target) for target in contents),
        removals=tuple((path, path.stat().st_ino) for path in stale if path.exists()),
    )
    is_set = len(transaction.moves) + len(transaction.removals) > 1
    try:
        if is_set:
            transaction.write_journals()
        for staged, target in transaction.moves:
            write_synced(staged, contents[target])
            _copy_owner_and_mode(target, staged)
        if is_set:
            _sync_folders(folders)
            write_synced(transaction.commit, b"")
        with _signals_deferred():
            transaction.finish()
        _sync_folders(folders)
    finally:
        transaction.clean_up()


def _copy_owner_and_mode(source: Path, target: Path) -> None:
    """Give ``target`` the owner and mode of ``source``, as far as the system allows; nothing without a ``source``."""
    with contextlib.suppress(FileNotFoundError):
        status = source.stat()
        with contextlib.suppress(PermissionError):
            if hasattr(os, "chown"):
                os.chown(target, status.st_uid, status.st_gid)
        target.chmod(stat.S_IMODE(status.st_mode))


def write_synced(path: Path, data: bytes) -> None:
    """Create a file and sync it to the disk."""
    with path.open("xb") as stream:
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())


def _sync_folders(folders: Iterable[Path]) -> None:
    """Sync the file names in ``folders`` to the disk, on systems that can sync a folder."""
    for folder in folders:
        with contextlib.suppress(OSError):
            handle = os.open(folder, os.O_RDONLY)
            try:
                os.fsync(handle)
            finally:
                os.close(handle)


@contextlib.contextmanager
def _signals_deferred() -> Iterator[None]:
    """Defer SIGINT and SIGTERM until the few renames are done."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received: list[int] = []
    handlers: dict[signal.Signals, Any] = {}
    for number in (signal.SIGINT, signal.SIGTERM):
        handlers[number] = signal.signal(number, lambda number, _: received.append(number)) or signal.SIG_DFL
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for late in received:
            signal.raise_signal(late)


@contextlib.contextmanager
def locked(folders: Iterable[Path]) -> Iterator[None]:
    """Keep other rovid processes from writing in ``folders``, after recovery of interrupted sets there.

    Raises
    ------
    OSError
        A folder cannot be written.
    OutputError
        Another process holds the lock of a folder for longer than a minute.
    """
    wanted = set(folders)
    while True:
        with contextlib.ExitStack() as stack:
            # All processes lock in the same order, which excludes a deadlock.
            for folder in sorted(wanted):
                stack.enter_context(_folder_lock(folder))
            # An interrupted set may have files in further folders.
            further = {other for folder in wanted for other in _interrupted_in(folder)} - wanted
            if not further:
                for folder in wanted:
                    _recover_locked(folder)
                yield
                return
            wanted |= further


def recover(folder: Path) -> None:
    """Finish or undo the sets that a killed process left incomplete in ``folder``, if the folder can be written."""
    with contextlib.suppress(OSError, OutputError):
        if _interrupted_in(folder):
            with locked([folder]):
                pass


@contextlib.contextmanager
def _folder_lock(folder: Path) -> Iterator[None]:
    from filelock import FileLock, Timeout

    path = folder / _LOCK
    lock = FileLock(path, timeout=_LOCK_TIMEOUT, mode=0o666)
    try:
        lock.acquire()
    except Timeout as error:
        text = "is being written by another process of rovid."
        raise OutputError(text, where=folder, mend="Wait until that process has ended, then try again.") from error
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise
    try:
        yield
    finally:
        # The file is deleted while its lock is held. A process that waits for it notices that and creates a new file.
        with contextlib.suppress(OSError):
            path.unlink()
        lock.release()


def _leftovers(folder: Path) -> list[Path]:
    """Journals, staged files and commit files in ``folder``."""
    return [Path(item.path) for item in os.scandir(folder) if item.name.startswith(_PREFIX) and item.name != _LOCK]


def _interrupted_in(folder: Path) -> set[Path]:
    """All folders of the interrupted sets that have a journal in ``folder``."""
    found = [_read_journal(path) for path in _leftovers(folder) if path.suffix == _JOURNAL_SUFFIX]
    return {path.parent for one in found if one is not None for path in one.journals if path.parent.is_dir()}


def _recover_locked(folder: Path) -> None:
    for path in _leftovers(folder):
        if path.suffix != _JOURNAL_SUFFIX or not path.exists():
            continue
        transaction = _read_journal(path)
        if transaction is None:
            continue
        if transaction.commit.exists():
            transaction.finish()
        transaction.clean_up()
    for path in _leftovers(folder):
        path.unlink(missing_ok=True)
