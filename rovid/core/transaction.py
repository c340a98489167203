"""Sets of files that are replaced together, under a lock on each of their folders.

A set is written in four steps:

1. The new files are staged next to their targets and synced to the disk.
2. A journal in each folder of the set lists the staged files, their targets and the stale files. The set counts as
   written once the journal in the first folder exists, which is written last.
3. The staged files are renamed to their targets, and stale files are deleted.
4. The journals are deleted, the one in the first folder before the others.

A process that is killed or interrupted in step 3 leaves old and new files side by side. The next rovid that comes to
one of the folders calls `recover`: with a journal in the first folder it repeats step 3, otherwise it deletes the
staged files.
"""

import contextlib
import errno
import json
import os
import secrets
import stat
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rovid.core.errors import OutputError

_PREFIX = ".rovid-"
_LOCK = f"{_PREFIX}lock"
_JOURNAL_SUFFIX, _PART_SUFFIX = ".set", ".part"
# s; writing a set takes far less.
_LOCK_TIMEOUT = 60.0
# Error numbers of file systems without locks. One rovid process at a time is safe on them without a lock.
_NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP)


@dataclass(frozen=True, kw_only=True)
class _Transaction:
    """What replaces a set of files."""

    #: Path of the journal in each folder of the set. The set counts as written once the first one exists.
    journals: tuple[Path, ...]
    moves: tuple[tuple[Path, Path], ...]  #: (staged file, target) of each new file.
    #: (stale file, its inode). A file with another inode was written since, and stays.
    removals: tuple[tuple[Path, int], ...]

    @property
    def is_committed(self) -> bool:
        """Whether the set counts as written."""
        return self.journals[0].exists()

    def commit(self) -> None:
        """Write the journals, the first one last. Paths in a journal are relative to its folder, which may be moved."""
        for journal in reversed(self.journals):

            def relative(path: Path, folder: Path = journal.parent) -> str:
                return os.path.relpath(path, folder)

            document = {
                "journals": list(map(relative, self.journals)),
                "moves": [[relative(staged), relative(target)] for staged, target in self.moves],
                "removals": [[relative(path), inode] for path, inode in self.removals],
            }
            # Under its name a journal is complete.
            part = journal.with_suffix(_PART_SUFFIX)
            write_synced(part, json.dumps(document).encode())
            part.rename(journal)

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
        """Delete journals and staged files. The first journal goes first: without it nothing is moved."""
        parts = (journal.with_suffix(_PART_SUFFIX) for journal in self.journals)
        for path in (*self.journals, *parts, *(staged for staged, _ in self.moves)):
            path.unlink(missing_ok=True)


def _read_journal(path: Path) -> _Transaction:
    """The transaction in a journal."""

    def absolute(place: str) -> Path:
        return Path(os.path.normpath(path.parent / place))

    document = json.loads(path.read_bytes())
    moves = tuple((absolute(staged), absolute(target)) for staged, target in document["moves"])
    removals = tuple((absolute(place), int(inode)) for place, inode in document["removals"])
    return _Transaction(journals=tuple(map(absolute, document["journals"])), moves=moves, removals=removals)


def replace_files(contents: Mapping[Path, bytes], stale: Sequence[Path], folders: Sequence[Path]) -> None:
    """Write all ``contents`` and delete all ``stale`` files, or change nothing.

    The caller holds the locks of ``folders``, which are the folders of all these files. A single file needs no journal.
    Raises OSError if a file cannot be written. Nothing was changed.
    """
    name = _PREFIX + secrets.token_hex(8) + _JOURNAL_SUFFIX
    moves = tuple((target.parent / f"{_PREFIX}{secrets.token_hex(8)}.tmp", target) for target in contents)
    removals = tuple((path, path.stat().st_ino) for path in stale if path.exists())
    transaction = _Transaction(journals=tuple(folder / name for folder in folders), moves=moves, removals=removals)
    try:
        for staged, target in transaction.moves:
            write_synced(staged, contents[target])
            # The owner and mode of the target, as far as the system allows.
            with contextlib.suppress(FileNotFoundError):
                status = target.stat()
                with contextlib.suppress(PermissionError):
                    if hasattr(os, "chown"):
                        os.chown(staged, status.st_uid, status.st_gid)
                staged.chmod(stat.S_IMODE(status.st_mode))
        if len(transaction.moves) + len(transaction.removals) > 1:
            _sync_folders(folders)
            transaction.commit()
        transaction.finish()
        _sync_folders(folders)
    except BaseException as error:
        # The next command finishes a set that was interrupted while its files were renamed.
        if isinstance(error, OSError) or not transaction.is_committed:
            transaction.clean_up()
        raise
    transaction.clean_up()


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
def locked(folders: Iterable[Path]) -> Iterator[None]:
    """Keep other rovid processes from writing in ``folders``, after recovery of interrupted sets there.

    Raises OSError if a folder cannot be written. Raises OutputError if another process holds the lock of a folder for
    longer than a minute.
    """
    wanted = set(folders)
    while True:
        with contextlib.ExitStack() as stack:
            # All processes lock in the same order, which excludes a deadlock.
            for folder in sorted(wanted):
                stack.enter_context(_folder_lock(folder))
            # An interrupted set may have files in further folders.
            interrupted = [_read_journal(journal) for folder in wanted for journal in _journals(folder)]
            places = {journal.parent for one in interrupted for journal in one.journals}
            further = set(filter(Path.is_dir, places)) - wanted
            if not further:
                for folder in wanted:
                    _recover_locked(folder)
                yield
                return
            wanted |= further


def recover(folder: Path) -> None:
    """Finish or undo the sets that a killed process left incomplete in ``folder``, if the folder can be written."""
    with contextlib.suppress(OSError, OutputError):
        if _journals(folder):
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


def _journals(folder: Path) -> list[Path]:
    return list(folder.glob(f"{_PREFIX}*{_JOURNAL_SUFFIX}"))


def _recover_locked(folder: Path) -> None:
    for journal in _journals(folder):
        transaction = _read_journal(journal)
        if transaction.is_committed:
            transaction.finish()
        transaction.clean_up()
    for path in folder.glob(f"{_PREFIX}*"):
        if path.name != _LOCK:
            path.unlink(missing_ok=True)
