"""Outputs: claimed before the work, written after it."""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import signal
import stat
import tempfile
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from rovid.core.errors import OutputError, RovidError
from rovid.core.folder_lock import locked, recover
from rovid.core.journal import PREFIX, Journal, new_journal, survivor, sync_folder, write_synced
from rovid.core.signatures import FileSignature

# Content that depends on what is there is made while nobody else writes.
Content = str | bytes | Callable[[], str | bytes]
_ELSEWHERE = "Choose another name."


@dataclass(frozen=True)
class OutputFile:
    """A file to be written, and of what kind it is."""

    path: Path
    signature: FileSignature

    @property
    def target(self) -> Path:
        """The file itself, where ``path`` is a link to it."""
        return Path(os.path.realpath(self.path))


class OutputSet:
    """Leave to write some files, asked for before the work that they come from.

    Parameters
    ----------
    outputs
        What will be written.
    force
        Whether what rovid did not write may be replaced.
    protected
        Files that are never replaced, whatever is in them.

    Raises
    ------
    OutputError
        One of the files may not be replaced, or its place cannot be written.
    """

    def __init__(self, outputs: Sequence[OutputFile], *, force: bool = False, protected: Iterable[Path] = ()) -> None:
        self._force = force
        self._protected = tuple(protected)
        targets = Counter(output.target for output in outputs)
        for output in outputs:
            if targets[output.target] > 1:
                raise OutputError("is the place of two outputs.", where=output.path, mend=_ELSEWHERE)
            try:
                recover(_standing(output.target.parent))
                self._require_free(output)
                with tempfile.TemporaryFile(dir=_standing(output.target.parent)):
                    pass
            except OSError as error:
                raise _not_written(output.path, error) from error

    def write(self, contents: Mapping[OutputFile, Content], *, stale: Iterable[Path] = ()) -> None:
        """Write all of them or none, and take away ``stale`` with it.

        Raises
        ------
        OutputError
            They cannot be written after all; it says where they are instead.
        """
        data: dict[OutputFile, bytes] = {}
        try:
            gone = [Path(os.path.realpath(path)) for path in stale]
            targets = [output.target for output in contents]
            folders = sorted({path.parent for path in (*targets, *gone)})
            for folder in folders:
                folder.mkdir(parents=True, exist_ok=True)
            with locked(folders):
                data = _all_encoded(contents)
                changed = [output for output, content in data.items() if not _holds(output.target, content)]
                for output in changed:
                    self._require_free(output, certain=True)
                _write({output.target: data[output] for output in changed}, gone, folders)
        except OSError as error:
            first = next(iter(contents))
            self.save_elsewhere(data or _all_encoded(contents), _not_written(first.path, error))
        except OutputError as error:
            if not all(output.signature.replaceable for output in contents):
                raise  # another file of that name was there all the time
            self.save_elsewhere(data or _all_encoded(contents), error)

    def save_elsewhere(self, contents: Mapping[OutputFile, bytes], reason: RovidError) -> NoReturn:
        """Save what cannot be written into a new folder somewhere else.

        Raises
        ------
        OutputError
            Always, with the reason and the folder.
        """
        top = Path(os.path.commonpath([output.target.parent for output in contents]))
        files = {os.path.relpath(output.target, top): content for output, content in contents.items()}
        for place in _places():
            folder = None
            try:
                folder = Path(tempfile.mkdtemp(prefix="rovid-result-", dir=place))
                for name, content in files.items():
                    (folder / name).parent.mkdir(parents=True, exist_ok=True)
                    write_synced(folder / name, content)
            except OSError:
                if folder is not None:
                    shutil.rmtree(folder, ignore_errors=True)
                continue
            saved = folder / next(iter(files)) if len(files) == 1 else folder
            raise OutputError(f"{reason} Nothing is lost: what was to stand there is in {saved}.") from reason
        raise OutputError(f"{reason} Nor could it be saved anywhere else.") from reason

    def _require_free(self, output: OutputFile, *, certain: bool = False) -> None:
        """Refuse what must not be replaced; where ``certain``, the new file is known to differ from what is there."""
        target, form = output.target, output.signature
        try:
            there = target.stat()
        except FileNotFoundError:
            return
        if not stat.S_ISREG(there.st_mode):
            what = "a folder" if stat.S_ISDIR(there.st_mode) else "a pipe, socket or device"
            raise OutputError(f"is {what}; a file was expected.", where=output.path, mend=_ELSEWHERE)
        marked = form.matches(target)
        if marked and not form.replaceable and not certain:
            return
        protected = [path for path in self._protected if path.exists()]
        if any(path.samefile(target) for path in protected):
            raise OutputError(
                "belongs to what is read here and is not written over.", where=output.path, mend=_ELSEWHERE
            )
        if not os.access(target, os.W_OK):
            raise OutputError("is write-protected.", where=output.path, mend=_ELSEWHERE)
        if there.st_size and not (marked and form.replaceable) and not self._force:
            raise OutputError(
                f"is there already and is not {form.description}.",
                where=output.path,
                mend="Choose another name, or give --force to write over it.",
            )


def _write(files: Mapping[Path, bytes], stale: Sequence[Path], folders: Sequence[Path]) -> None:
    """Stage all beside their targets, then put them in place."""
    moves = [(target.parent / f"{PREFIX}{secrets.token_hex(8)}.tmp", target) for target in files]
    removals = [(path, path.stat().st_ino) for path in stale if path.exists()]
    journal = new_journal(folders, moves, removals)
    is_set = len(moves) + len(removals) > 1
    try:
        if is_set:
            journal.write()
        for staged, target in moves:
            write_synced(staged, files[target])
            _take_after(staged, target)
        if is_set:
            _commit(journal, folders)
        else:
            journal.put_in_place()
        _sync(folders)
    finally:
        journal.close()


def _commit(journal: Journal, folders: Sequence[Path]) -> None:
    _sync(folders)
    write_synced(journal.commit, b"")
    with _undisturbed(), survivor(journal):
        journal.put_in_place()
        journal.close()


def _take_after(new: Path, old: Path) -> None:
    """Give a new file the owner and the mode of the one that it replaces, as far as that is allowed."""
    with contextlib.suppress(FileNotFoundError):
        was = old.stat()
        with contextlib.suppress(PermissionError):
            if hasattr(os, "chown"):
                os.chown(new, was.st_uid, was.st_gid)
        new.chmod(stat.S_IMODE(was.st_mode))


def _sync(folders: Iterable[Path]) -> None:
    for folder in folders:
        sync_folder(folder)


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """Put off what would end the process until the few renames are done."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    before: dict[signal.Signals, Any] = {}
    for number in (signal.SIGINT, signal.SIGTERM):
        before[number] = signal.signal(number, lambda number, _: came.append(number)) or signal.SIG_DFL
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for late in came:
            signal.raise_signal(late)


def _holds(target: Path, content: bytes) -> bool:
    """Whether exactly this is there already."""
    return target.is_file() and target.stat().st_size == len(content) and target.read_bytes() == content


def _all_encoded(contents: Mapping[OutputFile, Content]) -> dict[OutputFile, bytes]:
    return {output: _encoded(content) for output, content in contents.items()}


def _encoded(content: Content) -> bytes:
    made = content() if callable(content) else content
    if isinstance(made, str):
        return made.encode("utf-8")
    return made


def _standing(folder: Path) -> Path:
    """The folder, or the nearest above it that is there."""
    while not folder.exists():
        folder = folder.parent
    return folder


def _places() -> Iterator[Path]:
    """Where a result may be saved that cannot go to its place."""
    for place in (Path.cwd, Path.home, lambda: Path(tempfile.gettempdir())):
        # The working folder may be gone, a user may have no home, a machine no temporary folder.
        with contextlib.suppress(OSError, RuntimeError):
            yield place()


def _not_written(path: Path, error: OSError) -> OutputError:
    return OutputError(
        f"cannot be written ({error.strerror or error}).", where=path, mend="Choose another place with -o or -p."
    )
