"""Which files the page may see: what lies below one folder; and where logs go that are dropped on it."""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import shutil
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import BinaryIO

from rovid.core.errors import ConfigError, OutputError, RovidError, is_visible
from rovid.core.paths import list_files
from rovid.trial.log_files import FORMATS

# Bytes of one file that is dropped on the page.
LARGEST = 4 << 30
_PART = ".rovid-upload-"
_SPARE = 200 << 20
_LONGEST = 120
_DEEPEST = 8
# What some system takes for more than a part of a name, and what Windows takes for devices.
_SPECIAL = re.compile(r'[\\/:*?"<>|]')
_DEVICES = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)(\..*)?")


@dataclass(frozen=True, kw_only=True)
class RootFolder:
    """The folder below which everything is that the page reads or writes."""

    folder: Path

    @classmethod
    def for_logs(cls, logs: Sequence[Path]) -> RootFolder:
        """The working folder, if ``logs`` are in it; else what holds them."""
        here = Path.cwd().resolve()
        real = [log.resolve() for log in logs]
        if all(one.is_relative_to(here) and all(map(_is_plain, one.relative_to(here).parts)) for one in real):
            return cls(folder=here)
        folders = [one if one.is_dir() else one.parent for one in real]
        return cls(folder=Path(os.path.commonpath(folders)))

    def path(self, name: str) -> Path:
        """What ``name``, with / between its parts, stands for.

        Raises
        ------
        RovidError
            It is not below the folder, or hidden.
        """
        parts = [part for part in name.split("/") if part not in {"", "."}]
        odd = name.startswith(("/", "~")) or any(not _is_plain(part) for part in parts)
        if odd or len(parts) > 100:
            raise self._outside(name)
        # What Path makes of it might be another drive, and a link might lead anywhere.
        path = self.folder.joinpath(*parts)
        if not path.is_relative_to(self.folder) or not self.contains(path):
            raise self._outside(name)
        return path

    def contains(self, path: Path) -> bool:
        """Whether ``path`` is below the folder wherever links lead."""
        try:
            return path.resolve().is_relative_to(self.folder)
        except (OSError, RuntimeError):  # a loop of links
            return False

    def name(self, path: Path) -> str:
        """``path`` as the page knows it."""
        return "" if path == self.folder else path.relative_to(self.folder).as_posix()

    def require(self, paths: Sequence[Path]) -> None:
        """Refuse logs of which one is a link that leads out of the folder.

        Raises
        ------
        RovidError
            There is such a link.
        """
        for path in paths:
            for file in list_files(path, lambda _: None).files:
                if file.suffix.lower() in FORMATS and not self.contains(file):
                    raise ConfigError(
                        f"is a link that leads out of {self.folder}, and `rovid open` reads nothing outside.",
                        where=file,
                        mend="Copy the log there, or use the command line.",
                    )

    def folders(self, name: str) -> list[tuple[str, int]]:
        """Names of the folders in one, and how many logs lie in each."""
        here = self.path(name)
        inside = sorted(item for item in _listed(here) if item.is_dir() and self.contains(item))
        return [(self.name(item), sum(map(_is_log, _listed(item)))) for item in inside]

    def new_folder(self) -> Path:
        """A folder for logs that are dropped on the page."""
        name = f"logs_{datetime.now().astimezone():%Y-%m-%d_%H%M}"
        for number in range(1, 1000):
            folder = self.folder / (name if number == 1 else f"{name}_{number}")
            with contextlib.suppress(FileExistsError):
                folder.mkdir()
                return folder
        raise OutputError("no further folder can be made.", where=self.folder)

    def _outside(self, name: str) -> RovidError:
        return ConfigError(
            f"is not below {self.folder}, or is hidden.",
            where=name,
            mend="Start `rovid open` with the folder that holds the logs.",
        )


def _is_plain(part: str) -> bool:
    return not part.startswith(".") and "\\" not in part and "\0" not in part


def _listed(folder: Path) -> list[Path]:
    try:
        return [item for item in folder.iterdir() if not item.name.startswith(".")]
    except OSError:
        return []


def _is_log(path: Path) -> bool:
    return path.suffix.lower() in FORMATS


def clean_name(name: str) -> Path:
    """Where a file that is dropped goes in its new folder: its name without what no file is called.

    Raises
    ------
    RovidError
        It is called as no log.
    """
    parts = [_clean(part) for part in re.split(r"[\\/]", name) if part not in {"", ".", ".."}]
    path = Path(*parts[-_DEEPEST:]) if parts else Path("log")
    if path.suffix.lower() not in FORMATS:
        raise ConfigError(
            f"is no log that rovid reads; {', '.join(FORMATS)} were expected.",
            where=name,
            mend="Drop logs alone; rovid.toml is made here.",
        )
    return path


def _clean(part: str) -> str:
    seen = "".join(sign for sign in unicodedata.normalize("NFC", part) if is_visible(sign))
    plain = _SPECIAL.sub("_", seen).strip(". ")
    stem, dot, suffix = plain.rpartition(".")
    kept = f"{stem[: _LONGEST - len(suffix)]}{dot}{suffix}"[-_LONGEST:]
    return f"_{kept}" if not kept or _DEVICES.fullmatch(kept) else kept


@dataclass(kw_only=True)
class Upload:
    """A file on its way: written beside its place, and put there whole; nothing is replaced."""

    name: Path
    home: Path
    part: Path
    stream: BinaryIO
    size: int = 0

    @classmethod
    def start(cls, folder: Path, name: Path) -> Upload:
        """Make room for it."""
        home = (folder / name).parent
        home.mkdir(parents=True, exist_ok=True)
        part = home / f"{_PART}{secrets.token_hex(8)}"
        return cls(name=name, home=home, part=part, stream=part.open("xb"))

    def check_size(self, size: str) -> None:
        """Refuse at once what says that it is too large."""
        if size.isdigit():
            self._require_room(int(size))

    def write(self, data: bytes) -> None:
        """The next part of it."""
        self.size += len(data)
        self._require_room(self.size)
        self.stream.write(data)

    def _require_room(self, size: int) -> None:
        if size - self.size > shutil.disk_usage(self.home).free - _SPARE:
            raise OutputError("does not fit on the disk.", where=self.name, mend="Make room there.")
        if size > LARGEST:
            raise OutputError(
                f"is larger than {LARGEST >> 30} GB, which is the most that the page takes.",
                where=self.name,
                mend="Copy it into a folder, and start `rovid open` with that.",
            )

    def finish(self) -> Path:
        """Put it in its place, or beside what is there by now."""
        self.stream.close()
        for number in range(1, 10_000):
            place = self.home / (self.name.name if number == 1 else f"{self.name.stem}_{number}{self.name.suffix}")
            try:
                os.link(self.part, place)
            except FileExistsError:
                continue
            except OSError:  # a file system without links
                if place.exists():
                    continue
                self.part.rename(place)
            return place
        raise OutputError("no further name is free.", where=self.name)

    def close(self) -> None:
        """Take away what is left of it."""
        self.stream.close()
        self.part.unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            self.home.rmdir()  # where nothing came into it
