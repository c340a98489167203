"""Files of one set, put in place together: all of the new set, or the old one, whenever the process is killed.

Each folder of the set holds a journal from before the first file is staged. One commit file says that all are staged.
Until it is there a killed writer's files are taken away, from then on they are put in place: by the survivor, which is
this module run as a program, and where that was killed too by the next rovid that comes to one of the folders.

The survivor has to start at once and without a site, so that the standard library alone is imported here.
"""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

PREFIX = ".rovid-"
JOURNAL = ".journal"


@dataclass(frozen=True)
class Journal:
    """What is to be done with a set.

    Attributes
    ----------
    journals
        The journal's own place in each folder.
    commit
        Whether this is there decides between forth and back.
    moves
        (staged, target) of each file.
    removals
        (file, inode) of what the new set does not have any more.
    """

    journals: tuple[Path, ...]
    commit: Path
    moves: tuple[tuple[Path, Path], ...]
    removals: tuple[tuple[Path, int], ...]

    @property
    def folders(self) -> set[Path]:
        """The folders of the set."""
        return {journal.parent for journal in self.journals}

    def write(self) -> None:
        """Write it into each folder, with places relative to that, for folders may be moved."""
        for journal in self.journals:
            places = _Relative(journal.parent)
            document = {
                "journals": [places.of(path) for path in self.journals],
                "commit": places.of(self.commit),
                "moves": [[places.of(staged), places.of(target)] for staged, target in self.moves],
                "removals": [[places.of(path), inode] for path, inode in self.removals],
            }
            write_synced(journal, json.dumps(document).encode())

    def put_in_place(self) -> None:
        """Move every file to its target; what was moved before stays where it is."""
        for staged, target in self.moves:
            try:
                os.replace(staged, target)  # noqa: PTH105 - the tests stop the writer at each of these
            except FileNotFoundError:
                if staged.exists():
                    raise
        for path, inode in self.removals:
            with contextlib.suppress(FileNotFoundError):
                if path.stat().st_ino == inode:
                    path.unlink()

    def close(self) -> None:
        """Take away what is staged, and the journal; the commit first, without which nothing is moved any more."""
        for path in (self.commit, *(staged for staged, _ in self.moves), *self.journals):
            path.unlink(missing_ok=True)

    def settle(self) -> None:
        """Put in place what a killed writer had committed; take away what it had not."""
        if self.commit.exists():
            self.put_in_place()
        self.close()


class _Relative:
    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def of(self, path: Path) -> str:
        return os.path.relpath(path, self._folder)

    def at(self, place: str) -> Path:
        return Path(os.path.normpath(self._folder / place))


def new_journal(
    folders: Sequence[Path], moves: Sequence[tuple[Path, Path]], removals: Sequence[tuple[Path, int]]
) -> Journal:
    """A journal for a set in ``folders``; nothing is written yet."""
    name = PREFIX + secrets.token_hex(8)
    journals = tuple(folder / (name + JOURNAL) for folder in folders)
    commit = folders[0] / f"{name}.commit"
    return Journal(journals=journals, commit=commit, moves=tuple(moves), removals=tuple(removals))


def read_journal(path: Path) -> Journal | None:
    """The journal that stands there; None where its writer did not come to its end, and thus staged nothing."""
    places = _Relative(path.parent)
    try:
        document = json.loads(path.read_bytes())
        return Journal(
            journals=tuple(places.at(place) for place in document["journals"]),
            commit=places.at(document["commit"]),
            moves=tuple((places.at(staged), places.at(target)) for staged, target in document["moves"]),
            removals=tuple((places.at(place), int(inode)) for place, inode in document["removals"]),
        )
    except (ValueError, KeyError, TypeError):
        return None


def write_synced(path: Path, data: bytes) -> None:
    """Write a new file, and have it on the disk."""
    with path.open("xb") as stream:
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())


def sync_folder(folder: Path) -> None:
    """Have a folder's names on the disk, where the system can do that for a folder."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


@contextlib.contextmanager
def survivor(journal: Journal) -> Iterator[None]:
    """Have a process of its own beside this one, that settles ``journal`` should this one be killed.

    Its standard error is ours: whoever waits for all that we say waits for it too.
    """
    try:
        # -S and -I: no site, no environment, and nothing imported from the folder.
        process = subprocess.Popen(  # noqa: S603 - this very file, run by this very interpreter
            [sys.executable, "-I", "-S", __file__, journal.journals[0]],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            start_new_session=True,
        )
    except OSError:  # it cannot be had: the next rovid in the folder will do
        yield
        return
    with process:  # closes the pipe at the end, which sets it going, and waits for it
        yield


def main() -> None:
    """Wait for the end of the process that started this one, and settle what it left."""
    sys.stdin.buffer.read()
    # What this cannot put in place is left to the next rovid in the folder, which has a user to tell.
    with contextlib.suppress(OSError):
        journal = read_journal(Path(sys.argv[1]))
        if journal is not None and journal.commit.exists():
            journal.settle()


if __name__ == "__main__":
    main()
