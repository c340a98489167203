"""Checks of input paths. Only regular files and folders are opened: reading a pipe or a device might never end."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from rovid.core.errors import ConfigError, RovidError, close_matches, quoted_list

_LINK_LOOP = "a link in a loop"
_LINK_UP = "a link to a folder that it lies in"
_SPECIAL_KINDS: Mapping[Callable[[int], bool], str] = {
    stat.S_ISFIFO: "a pipe",
    stat.S_ISSOCK: "a socket",
    stat.S_ISCHR: "a device",
    stat.S_ISBLK: "a device",
}
_ABSENT = {errno.ENOENT, errno.ENOTDIR}


@dataclass(frozen=True, kw_only=True)
class FolderContents:
    """Files in a folder and in the folders inside it, without hidden ones."""

    files: tuple[Path, ...]  #: Regular files and dangling links, sorted.
    special_files: Mapping[Path, str]  #: Path -> kind of everything that is neither a regular file nor a folder.


def file_parts(path: Path) -> list[Path]:
    """The file and its write-ahead log, if there is one: an SQLite file keeps part of its contents in NAME-wal."""
    if path.suffix.lower() != ".db3":
        return [path]
    journal = Path(os.path.realpath(path) + "-wal")
    return [path, journal] if journal.is_file() and journal.stat().st_size else [path]


def special_kind(path: Path) -> str:
    """Kind of a special file, such as "a pipe"; empty for a regular file, a folder or nothing."""
    try:
        mode = path.stat().st_mode
    except ValueError:  # the name contains NUL
        return ""
    except OSError as error:
        return _LINK_LOOP if error.errno == errno.ELOOP else ""
    for test, kind in _SPECIAL_KINDS.items():
        if test(mode):
            return kind
    return ""


def require_regular(path: Path, error: type[RovidError] = ConfigError) -> None:
    """Refuse a path that is neither a regular file nor a folder.

    Raises
    ------
    RovidError
        The path is a pipe, a socket, a device, or a link in a loop.
    """
    if kind := special_kind(path):
        raise error(f"is {kind}; a file was expected.", where=path, mend="Write its content to a file first.")


def require_exists(path: Path, error: type[RovidError] = ConfigError) -> None:
    """Refuse a path at which there is neither a regular file nor a folder.

    Raises
    ------
    RovidError
        There is nothing, it cannot be reached, or it is a pipe, a socket, a device, or a link in a loop.
    """
    require_regular(path, error)
    try:
        path.stat()
    except OSError as reason:
        if reason.errno not in _ABSENT:
            raise error(f"cannot be read ({reason.strerror}).", where=path) from reason
        mend = f"{_nearest_names(path)}Give a log or the folder that holds the logs."
        raise error("there is no such file or folder.", where=path, mend=mend) from reason


def _nearest_names(path: Path) -> str:
    """A sentence with names in the folder of ``path`` that are similar to its name; empty if there are none."""
    try:
        close = close_matches(path.name, sorted(other.name for other in path.parent.iterdir()))
    except (OSError, ValueError):
        return ""
    return f"Nearest: {quoted_list(close)}. " if close else ""


def list_files(path: Path, unreadable: Callable[[OSError], None]) -> FolderContents:
    """All files in a folder and the folders inside it, or the file ``path`` itself. Links to folders are not followed.

    Parameters
    ----------
    unreadable
        Called for each inner folder that cannot be read.
    """
    if not path.is_dir():
        return FolderContents(files=(path,), special_files={})
    files: list[Path] = []
    special: dict[Path, str] = {}
    for folder, folders, names in os.walk(path, onerror=unreadable):
        # os.walk goes on with the folders that are left in this list.
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        inner = [Path(folder, name) for name in names if not name.startswith(".")]
        for found in (*(Path(folder, name) for name in folders), *inner):
            if kind := special_kind(found) or _upward_link(found):
                special[found] = kind
        files += [found for found in inner if found not in special]
    return FolderContents(files=tuple(sorted(files)), special_files=dict(sorted(special.items())))


def _upward_link(path: Path) -> str:
    """A description if ``path`` is a link to a folder that contains it; otherwise empty."""
    if path.is_symlink() and path.parent.resolve().is_relative_to(path.resolve()):
        return _LINK_UP
    return ""
