"""Input files: only regular files and folders are opened, and TOML is read within limits of size and depth."""

import contextlib
import errno
import math
import os
import re
import stat
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rovid.core.errors import ConfigError, RovidError, close_matches, display_text, quoted_list

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

    Raises RovidError if the path is a pipe, a socket, a device, or a link in a loop.
    """
    if kind := special_kind(path):
        raise error(f"is {kind}; a file was expected.", where=path, mend="Write its content to a file first.")


def require_exists(path: Path, error: type[RovidError] = ConfigError) -> None:
    """Refuse a path at which there is neither a regular file nor a folder.

    Raises RovidError if there is nothing, it cannot be reached, or it is a pipe, a socket, a device, or a link in a
    loop.
    """
    require_regular(path, error)
    try:
        path.stat()
    except OSError as reason:
        if reason.errno not in _ABSENT:
            raise error(f"cannot be read ({reason.strerror}).", where=path) from reason
        mend = "Give a log or the folder that holds the logs."
        with contextlib.suppress(OSError, ValueError):
            if close := close_matches(path.name, sorted(other.name for other in path.parent.iterdir())):
                mend = f"Nearest: {quoted_list(close)}. {mend}"
        raise error("there is no such file or folder.", where=path, mend=mend) from reason


def list_files(path: Path, unreadable: Callable[[OSError], None]) -> FolderContents:
    """All files in a folder and the folders inside it, or the file ``path`` itself. Links to folders are not followed.

    ``unreadable``: Called for each inner folder that cannot be read.
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
            if kind := special_kind(found):
                special[found] = kind
            elif found.is_symlink() and found.parent.resolve().is_relative_to(found.resolve()):
                special[found] = _LINK_UP
        files += [found for found in inner if found not in special]
    return FolderContents(files=tuple(sorted(files)), special_files=dict(sorted(special.items())))


# Bounds of a vehicle's quantities, in any unit. Their squares and quotients stay finite.
LARGEST, SMALLEST = 1e18, 1e-12
# Bytes; enough for thirty thousand logs with their hashes.
_MAX_SIZE = 4_000_000
# Nested tables. The parser needs time and memory by the square of the parts of a dotted key.
_MAX_DEPTH = 32
_DEEP_KEY = re.compile(rf"""(?<![\w"'-])(?:[\w"'-]++[ \t]*+\.[ \t]*+){{{_MAX_DEPTH}}}""")
_INTEGER_LIMIT = 1 << 63  # TOML guarantees 64 bits


def read_bytes(path: Path, most: int, expected: str, error: type[RovidError], mend: str = "") -> bytes:
    """The content of ``path``. Raises ``error`` if it is no file, cannot be read, or has more than ``most`` bytes."""
    require_regular(path, error)
    try:
        with path.open("rb") as file:
            content = file.read(most + 1)
    except OSError as refused:
        raise error(f"cannot be read ({refused.strerror}).", where=path) from refused
    if len(content) > most:
        raise error(f"is larger than {most / 1e6:g} MB; {expected} was expected.", where=path, mend=mend)
    return content


def read_toml(path: Path, mend: str = "") -> dict[str, Any]:
    """The document in ``path``, with integers of 64 bits at most.

    Raises ConfigError if the file cannot be read, is too large, or is not TOML.

    ``mend``: Advice for a file that is not TOML.
    """
    content = read_bytes(path, _MAX_SIZE, "a short text", ConfigError, mend)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigError("is not UTF-8 text.", where=path, mend=mend or "Save it as UTF-8.") from error
    too_deep = ConfigError(f"is nested deeper than {_MAX_DEPTH} levels.", where=path, mend=mend)
    if _DEEP_KEY.search(text):
        raise too_deep
    try:
        document = tomllib.loads(text)
    except RecursionError as error:
        raise too_deep from error
    except ValueError as error:  # also for a number with thousands of digits
        raise ConfigError(f"is not valid TOML: {_toml_error(str(error), text)}.", where=path, mend=mend) from error
    for keys, value in _all_values(document):
        if len(keys) > _MAX_DEPTH:
            raise too_deep
        if isinstance(value, int) and abs(value) >= _INTEGER_LIMIT:
            place = ".".join(display_text(key, 60) for key in keys)
            raise ConfigError("is an integer of more than 64 bits.", where=f"{path}: {place}", mend=mend)
    return document


def _toml_error(message: str, text: str) -> str:
    """The parser's ``message`` with the line that it means, and the usual cause of such a line."""
    message = message.partition(";")[0]
    place, lines = re.search(r"at line (\d+)", message), text.splitlines()
    if place is None or int(place[1]) > len(lines):
        return message
    line = display_text(lines[int(place[1]) - 1].strip(), 80)
    if re.search(r"=\s*[+-]?\d+,\d", line):
        return f"{message}: {line} (a decimal number needs a point)"
    if re.search(r"=\s*[^\W\d]", line):
        return f"{message}: {line} (text needs quotes)"
    return f"{message}: {line}"


def _all_values(document: dict[str, Any]) -> Iterator[tuple[tuple[str, ...], Any]]:
    """The document and all values in it, each with the keys that lead to it; without recursion, as it may be deep."""
    waiting: list[tuple[tuple[str, ...], Any]] = [((), document)]
    while waiting:
        keys, value = waiting.pop()
        yield keys, value
        if isinstance(value, dict):
            waiting += [((*keys, key), inner) for key, inner in value.items()]
        elif isinstance(value, list):
            waiting += [((*keys, str(number)), inner) for number, inner in enumerate(value, 1)]


def expected_number(value: object, *, positive: bool = False, largest: float = LARGEST) -> str:
    """Description of the number that was expected in place of ``value``; empty if ``value`` is such a number."""
    if isinstance(value, bool) or not isinstance(value, int | float) or math.isnan(value):
        return "a number"
    if positive and not value > 0.0:
        return "a positive number"
    if positive and not SMALLEST <= value <= largest:
        return f"a number between {SMALLEST:g} and {largest:g}"
    if not abs(value) <= largest:
        return f"a number up to {largest:g} in size"
    return ""
