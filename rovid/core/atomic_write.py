"""Output files: checked before the work starts, and written all or none after it."""

from __future__ import annotations

import contextlib
import os
import shutil
import stat
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from rovid.core.errors import OutputError, RovidError
from rovid.core.signatures import FileSignature
from rovid.core.transaction import locked, recover, replace_files, write_synced

# A function is called under the locks of the folders: its content may depend on files that are there.
Content = str | bytes | Callable[[], str | bytes]
_OTHER_NAME = "Choose another name."


@dataclass(frozen=True)
class OutputFile:
    """A file to be written, with the signature that files of its kind have."""

    path: Path
    signature: FileSignature

    @property
    def target(self) -> Path:
        """The file itself, if ``path`` is a link."""
        return Path(os.path.realpath(self.path))


class OutputSet:
    """Files that are written together. The constructor checks before the work that they can be written.

    Parameters
    ----------
    outputs
        The files.
    force
        Whether files that rovid did not write may be replaced.
    protected
        Files that are never replaced, whatever they contain.

    Raises
    ------
    OutputError
        A file must not be replaced, or its folder cannot be written.
    """

    def __init__(self, outputs: Sequence[OutputFile], *, force: bool = False, protected: Iterable[Path] = ()) -> None:
        self._force = force
        self._protected = tuple(protected)
        targets = Counter(output.target for output in outputs)
        for output in outputs:
            if targets[output.target] > 1:
                raise OutputError("is given as the place of two outputs.", where=output.path, mend=_OTHER_NAME)
            folder = output.target.parent
            while not folder.exists():
                folder = folder.parent
            try:
                recover(folder)
                self._require_replaceable(output)
                with tempfile.TemporaryFile(dir=folder):
                    pass
            except OSError as error:
                raise _not_written(output.path, error) from error

    def write(self, contents: Mapping[OutputFile, Content], *, stale: Iterable[Path] = ()) -> None:
        """Write all files and delete the ``stale`` ones, or change nothing.

        Raises
        ------
        OutputError
            The files cannot be written after all. The message says where they were saved instead.
        """
        data: dict[OutputFile, bytes] = {}
        try:
            removed = [Path(os.path.realpath(path)) for path in stale]
            targets = [output.target for output in contents]
            folders = sorted({path.parent for path in (*targets, *removed)})
            for folder in folders:
                folder.mkdir(parents=True, exist_ok=True)
            with locked(folders):
                data = _encoded(contents)
                changed = [output for output, content in data.items() if not _contains(output.target, content)]
                for output in changed:
                    self._require_replaceable(output, differs=True)
                replace_files({output.target: data[output] for output in changed}, removed, folders)
        except OSError as error:
            first = next(iter(contents))
            self.save_elsewhere(data or _encoded(contents), _not_written(first.path, error))
        except OutputError as error:
            if not all(output.signature.replaceable for output in contents):
                raise  # the user's own file was there before
            self.save_elsewhere(data or _encoded(contents), error)

    def save_elsewhere(self, contents: Mapping[OutputFile, bytes], reason: RovidError) -> NoReturn:
        """Save the contents in a new folder, because of a ``reason`` why they cannot go to their places.

        Raises
        ------
        OutputError
            Always, with the reason and the new folder.
        """
        top = Path(os.path.commonpath([output.target.parent for output in contents]))
        files = {os.path.relpath(output.target, top): content for output, content in contents.items()}
        for parent in _fallback_folders():
            folder = None
            try:
                folder = Path(tempfile.mkdtemp(prefix="rovid-result-", dir=parent))
                for name, content in files.items():
                    (folder / name).parent.mkdir(parents=True, exist_ok=True)
                    write_synced(folder / name, content)
            except OSError:
                if folder is not None:
                    shutil.rmtree(folder, ignore_errors=True)
                continue
            saved = folder / next(iter(files)) if len(files) == 1 else folder
            raise OutputError(f"{reason} Nothing is lost: the result was saved in {saved}.") from reason
        raise OutputError(f"{reason} The result could not be saved anywhere else either.") from reason

    def _require_replaceable(self, output: OutputFile, *, differs: bool = False) -> None:
        """Refuse a file that must not be replaced; ``differs``: the new content is known to differ from the old."""
        target, signature = output.target, output.signature
        try:
            status = target.stat()
        except FileNotFoundError:
            return
        if not stat.S_ISREG(status.st_mode):
            kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a pipe, socket or device"
            raise OutputError(f"is {kind}; a file was expected.", where=output.path, mend=_OTHER_NAME)
        matches = signature.matches(target)
        if matches and not signature.replaceable and not differs:
            return
        protected = [path for path in self._protected if path.exists()]
        if any(path.samefile(target) for path in protected):
            raise OutputError("is an input of this command and is never replaced.", where=output.path, mend=_OTHER_NAME)
        if not os.access(target, os.W_OK):
            raise OutputError("is write-protected.", where=output.path, mend=_OTHER_NAME)
        if status.st_size and not (matches and signature.replaceable) and not self._force:
            raise OutputError(
                f"is there already and is not {signature.description}.",
                where=output.path,
                mend="Choose another name, or give --force to replace it.",
            )


def _contains(target: Path, content: bytes) -> bool:
    """Whether the file exists with exactly this ``content``."""
    return target.is_file() and target.stat().st_size == len(content) and target.read_bytes() == content


def _encoded(contents: Mapping[OutputFile, Content]) -> dict[OutputFile, bytes]:
    data = {}
    for output, content in contents.items():
        made = content() if callable(content) else content
        data[output] = made.encode("utf-8", "backslashreplace") if isinstance(made, str) else made
    return data


def _fallback_folders() -> Iterator[Path]:
    """Folders for a result that cannot go to its place, as far as they exist."""
    for find in (Path.cwd, Path.home, lambda: Path(tempfile.gettempdir())):
        with contextlib.suppress(OSError, RuntimeError):
            yield find()


def _not_written(path: Path, error: OSError) -> OutputError:
    reason = error.strerror or error
    return OutputError(f"cannot be written ({reason}).", where=path, mend="Choose another place with -o or -p.")
