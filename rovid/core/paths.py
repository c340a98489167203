"""What may be opened: regular files and folders. A pipe or a device would be waited for without end."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from rovid.core.errors import ConfigError, RovidError, close_matches, quoted_list

_LOOP = "a link in a loop"
_ABOVE = "a link to a folder that it lies in"
_ODD: Mapping[Callable[[int], bool], str] = {
    stat.S_ISFIFO: "a pipe",
    stat.S_ISSOCK: "a socket",
    stat.S_ISCHR: "a device",
    stat.S_ISBLK: "a device",
}
_ABSENT = {errno.ENOENT, errno.ENOTDIR}


@dataclass(frozen=True, kw_only=True)
class FolderContents:
    """What a folder holds, hidden files and folders left out.

    Attributes
    ----------
    files
        By name: regular files, and links that lead nowhere.
    odd
        Of everything else that is neither file nor folder: what it is.
    """

    files: tuple[Path, ...]
    special_files: Mapping[Path, str]


def special_kind(path: Path) -> str:
    """What ``path`` is where it is neither file nor folder, as "a pipe"; empty where it is, or where nothing is."""
    try:
        mode = path.stat().st_mode
    except ValueError:  # a NUL, which no name holds
        return ""
    except OSError as error:
        return _LOOP if error.errno == errno.ELOOP else ""
    for test, what in _ODD.items():
        if test(mode):
            return what
    return ""


def require_regular(path: Path, error: type[RovidError] = ConfigError) -> None:
    """Refuse to open what is neither file nor folder.

    Raises
    ------
    RovidError
        It is a pipe, a socket, a device, or a link in a loop.
    """
    if what := special_kind(path):
        raise error(f"is {what}; a file was expected.", where=path, mend="Write what it holds to a file first.")


def require_exists(path: Path, error: type[RovidError] = ConfigError) -> None:
    """Refuse a path at which there is neither file nor folder.

    Raises
    ------
    RovidError
        Nothing is there, it cannot be reached, or it is a pipe, a socket, a device, or a link in a loop.
    """
    require_regular(path, error)
    try:
        path.stat()
    except OSError as reason:
        if reason.errno not in _ABSENT:
            raise error(f"cannot be read ({reason.strerror}).", where=path) from reason
        mend = f"{_beside(path)}Give a log or the folder that holds the logs."
        raise error("there is no such file or folder.", where=path, mend=mend) from reason


def _beside(path: Path) -> str:
    """What is called nearly as ``path`` in its folder, as a sentence; empty where nothing is."""
    try:
        close = close_matches(path.name, sorted(other.name for other in path.parent.iterdir()))
    except (OSError, ValueError):
        return ""
    return f"Nearest: {quoted_list(close)}. " if close else ""


def list_files(path: Path, on_error: Callable[[OSError], None]) -> FolderContents:
    """The file itself, or what the folder and those inside it hold; links to folders are not followed.

    Parameters
    ----------
    unreadable
        Told of each folder inside that cannot be read.
    """
    if not path.is_dir():
        return FolderContents(files=(path,), special_files={})
    files: list[Path] = []
    strange: dict[Path, str] = {}
    for here, folders, names in os.walk(path, onerror=on_error):
        # What os.walk is left with here is where it goes next.
        folders[:] = sorted(_shown(folders))
        inside = [Path(here, name) for name in _shown(names)]
        strange |= _strange((*(Path(here, name) for name in folders), *inside))
        files += [one for one in inside if one not in strange]
    return FolderContents(files=tuple(sorted(files)), special_files=dict(sorted(strange.items())))


def _strange(paths: Iterable[Path]) -> dict[Path, str]:
    """Those of ``paths`` that are not to be read or followed, and what they are."""
    whats = {path: special_kind(path) or _above(path) for path in paths}
    return {path: what for path, what in whats.items() if what}


def _shown(names: list[str]) -> list[str]:
    return [name for name in names if not name.startswith(".")]


def _above(path: Path) -> str:
    """That ``path`` is a link to a folder in which it lies; empty where it is not."""
    if path.is_symlink() and path.parent.resolve().is_relative_to(path.resolve()):
        return _ABOVE
    return ""
