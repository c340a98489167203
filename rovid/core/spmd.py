"""Copies of this process that go the same way beside it, and share with it what takes long.

Threads hand one lock to each other for all that is not compiled, however many cores there are. Copies do not: each does
for itself what is quick, and of what takes long a part, which it tells the others. So all have the same at any time,
and nothing but results goes from one to another.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

from rovid.core.fork import can_fork, fork_process, kill_child, silence_child
from rovid.core.threads import CORES_VARIABLE, core_count, thread_map

Item = TypeVar("Item")
Result = TypeVar("Result")

# More copies find little left to share.
_MOST = 3
# A place among the items that are shared, and what stands behind the last of them.
_PLACE, _NONE = struct.Struct("=I"), 2**32 - 1


def parallel_map(
    function: Callable[[Item], Result], items: Iterable[Item], *, among_threads: bool = True
) -> list[Result]:
    """``function`` of each of ``items``, shared with the copies where there are any, and among threads otherwise.

    Results go from one process to another: they are numbers, arrays and text, and nothing that is compared by identity.
    Where threads cannot have a part in it, it is done one after the other.
    """
    team, every = _TEAM, list(items)
    if team is not None:
        return team.share(function, every)
    return thread_map(function, every) if among_threads else [function(item) for item in every]


@contextlib.contextmanager
def forked_workers(*, wanted: bool = True) -> Iterator[bool]:
    """Copies go through all that is inside, and end where this process goes on; whether it is that one.

    There are none where none are ``wanted``, the system makes none, no core is free for one, or other threads may be
    at work.
    """
    if not wanted or _TEAM is not None or not can_fork():
        yield True
        return
    copies = _begin(min(core_count() - 1, _MOST))
    try:
        yield copies is not None
    finally:
        if copies is None:
            os._exit(0)
        _disband()
        for copy in copies:
            kill_child(copy)


def _begin(count: int) -> list[int] | None:
    """So many copies begin here, or as many as there is room for; their numbers, None in a copy."""
    places, lines, copies = os.pipe(), list[_Line](), list[int]()
    for _ in range(count):
        back, forth = os.pipe(), os.pipe()
        ours, theirs = _Line(back[0], forth[1]), _Line(forth[0], back[1])
        try:
            copy = fork_process()
        except OSError:
            ours.close()
            theirs.close()
            break
        if copy == 0:
            for line in (ours, *lines):
                line.close()
            os.close(places[1])
            silence_child()
            _join(_Team(places[0], None, [theirs]))
            return None
        theirs.close()
        lines.append(ours)
        copies.append(copy)
    team = _Team(places[0], places[1], lines)
    if copies:
        _join(team)
    else:
        team.close()
    return copies


@dataclass(frozen=True, eq=False)
class _Line:
    """Ends of pipes to and from another process."""

    reads: int
    writes: int

    def say(self, what: object) -> None:
        told = pickle.dumps(what, protocol=pickle.HIGHEST_PROTOCOL)
        with os.fdopen(self.writes, "wb", closefd=False) as pipe:
            pipe.write(_PLACE.pack(len(told)) + told)

    def hear(self) -> Any:
        with os.fdopen(self.reads, "rb", buffering=0, closefd=False) as pipe:
            (length,) = _PLACE.unpack(_read(pipe, _PLACE.size))
            return pickle.loads(_read(pipe, length))  # noqa: S301 - of a copy of this process

    def close(self) -> None:
        os.close(self.reads)
        os.close(self.writes)


def _read(pipe: Any, count: int) -> bytes:
    told = b""
    while len(told) < count:
        more = pipe.read(count - len(told))
        if not more:
            raise EOFError
        told += more
    return told


@dataclass(eq=False)
class _Team:
    """A process as one of those that go in step.

    Attributes
    ----------
    places
        Where each of them takes the place of its next item.
    hands_out
        Where the first process puts them; None in a copy.
    lines
        To each of the copies, or to the first process.
    is_at_work
        Whether it does its part of what is shared.
    share_before
        Its share of the cores before, as the environment had it; in a team it is one core.
    """

    places: int
    hands_out: int | None
    lines: Sequence[_Line]
    is_at_work: bool = False
    share_before: str | None = field(default_factory=lambda: os.environ.get(CORES_VARIABLE))

    def share(self, function: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
        """As `shared`; what is to be shared within that stays where it is, and one item is nothing to share."""
        if self.is_at_work or len(items) < 2:
            return [function(item) for item in items]
        self.is_at_work = True
        done: dict[int, Result] = {}
        try:
            if self.hands_out is not None:
                ends = [_NONE] * (1 + len(self.lines))
                os.write(self.hands_out, b"".join(map(_PLACE.pack, (*range(len(items)), *ends))))
            while (at := self._next()) != _NONE:
                done[at] = function(items[at])
            self._tell_each_other(done)
        except BaseException as error:
            if self.hands_out is None:
                os._exit(1)
            _disband()
            if not isinstance(error, OSError | EOFError):
                raise
        finally:
            self.is_at_work = False
        # What one had taken that ended before its time is done here.
        return [done[at] if at in done else function(item) for at, item in enumerate(items)]

    def _next(self) -> int:
        """Place of the item that nobody has taken yet."""
        told = os.read(self.places, _PLACE.size)
        if not told:
            raise EOFError
        return int(_PLACE.unpack(told)[0])

    def _tell_each_other(self, done: dict[int, Any]) -> None:
        """Until all have what any has ``done``: by way of the first process."""
        if self.hands_out is None:
            (first,) = self.lines
            first.say(done)
            done.update(first.hear())
            return
        for line in self.lines:
            done.update(line.hear())
        for line in self.lines:
            line.say(done)

    def close(self) -> None:
        """Whoever waits at the other ends is told that nobody comes."""
        for line in self.lines:
            line.close()
        for end in (self.places, self.hands_out):
            if end is not None:
                os.close(end)


_TEAM: _Team | None = None


def _join(team: _Team) -> None:
    global _TEAM  # noqa: PLW0603 - a process is in one team, whoever asks
    _TEAM = team
    os.environ[CORES_VARIABLE] = "1"


def _disband() -> None:
    """Go on alone, with all cores."""
    global _TEAM  # noqa: PLW0603 - as above
    if _TEAM is None:
        return
    _TEAM.close()
    del os.environ[CORES_VARIABLE]
    if _TEAM.share_before is not None:
        os.environ[CORES_VARIABLE] = _TEAM.share_before
    _TEAM = None
