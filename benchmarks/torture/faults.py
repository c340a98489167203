"""Kills at every step and at random moments, disks that are full or read-only, and commands that meet.

``python -m benchmarks.torture.faults`` tries every command that writes. Whatever happens: what stood there before or
what should stand there now, nothing between; one message; the next command works and nothing is left behind.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import resource
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from random import Random

from benchmarks.torture.apart import Apart, Ended, steps_in
from benchmarks.torture.campaign import CASES, Case, Tree, laid_out, must, restore, tree
from benchmarks.torture.commands import Failure
from benchmarks.torture.state import State, summary

# A helper of a killed command may still be at work.
_PATIENCE = 5.0
_NOBODY = 65534
_PATHS = re.compile(r"/[^\s:;,()'\"]+")
_BLOCK = 4096
_DRAG, _INERTIA = ("fit-drag", "L"), ("fit-inertia",)
# Name of a pair -> case that lays out the folder, and the two commands.
_PAIRS: Mapping[str, tuple[str, Sequence[str], Sequence[str]]] = {
    "drag and inertia": ("fit-inertia", (*_DRAG, "--cutoff", "0.3"), _INERTIA),
    "two pages": ("report", CASES["report"].new, CASES["report"].old),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """A command, its folder, the folder before it, and what is in the folder before and after it."""

    name: str
    case: Case
    folder: Path
    kept: Path
    old: Tree
    new: Tree
    steps: int
    seconds: float

    def reset(self) -> None:
        """Everything as before the command."""
        restore(self.folder, self.kept)


# What must hold


def scene(name: str, root: Path) -> Scene:
    """Run the command undisturbed, and again to check that the files are equal."""
    case, folder, kept = CASES[name], root / name / "folder", root / name / "kept"
    laid_out(folder, case)
    folder.rename(kept)
    restore(folder, kept)
    # In this process: forked processes then find all modules imported and all loops compiled.
    must(case.new, folder)
    new = tree(folder)
    restore(folder, kept)
    counted = root / name / "steps"

    def count() -> None:
        with counted.open("ab") as stream:
            stream.write(b".")

    one = Apart(case.new, folder, steps_in(folder, count)).ended()
    assert one.done is not None, f"{name} was killed"
    assert (one.done.code, one.done.failures) == (0, ()), f"{name}: {one.done}"
    again = tree(folder)
    assert new == again, f"{name} writes {[path for path in new if new[path] != again.get(path)]} anew each time"
    old, steps = tree(kept), counted.stat().st_size
    assert new != old, f"{name} changes nothing"
    return Scene(name=name, case=case, folder=folder, kept=kept, old=old, new=new, steps=steps, seconds=one.seconds)


def judged(one: Scene, what: str) -> Iterator[Failure]:
    """After a command was killed: all old or all new, and the next works and tidies up."""
    written = {path for path in one.new if one.new[path] != one.old.get(path)}
    until = time.perf_counter() + _PATIENCE
    while True:
        now = tree(one.folder)
        states = {path: _state(one, now, path) for path in written}
        if len(set(states.values())) == 1 and "neither" not in states.values():
            break
        if time.perf_counter() > until:
            text = ", ".join(f"{path} is {state}" for path, state in sorted(states.items()))
            yield Failure(kind="between old and new", where=f"{one.name}, {what}", text=text[:300])
            break
        time.sleep(0.01)
    touched = [path for path in one.old if path not in written and now.get(path) != one.old[path]]
    if touched:
        yield Failure(kind="touched", where=f"{one.name}, {what}", text=", ".join(touched))
    yield from went_on(one, what)


def went_on(one: Scene, what: str) -> Iterator[Failure]:
    """The next command has to work, and leave what it leaves when nothing went wrong before."""
    after = Apart(one.case.again or one.case.new, one.folder).ended().done
    if after is None or after.code or after.failures:
        yield Failure(kind="next command", where=f"{one.name}, {what}", text=str(after)[:300])
        return
    now = tree(one.folder)
    if left := sorted(set(now) - set(one.new)):
        yield Failure(kind="left behind", where=f"{one.name}, {what}", text=", ".join(left))
    if wrong := sorted(path for path in one.new if now.get(path) != one.new[path]):
        yield Failure(kind="next result", where=f"{one.name}, {what}", text=", ".join(wrong))
    if hidden := sorted(path for path in one.new if Path(path).name.startswith(".")):
        yield Failure(kind="left behind", where=f"{one.name}, in peace", text=", ".join(hidden))


def _state(one: Scene, now: Tree, path: str) -> str:
    if now.get(path) == one.new[path]:
        return "new"
    return "old" if now.get(path) == one.old.get(path) else "neither"


# What happens to it


def killed_at_step(one: Scene, step: int) -> Iterator[Failure]:
    """Just before one of its changes."""
    one.reset()
    left = iter(range(step - 1, 0, -1))

    def kill() -> None:
        if next(left, None) is None:
            os.kill(os.getpid(), signal.SIGKILL)

    Apart(one.case.new, one.folder, steps_in(one.folder, kill)).ended()
    yield from judged(one, f"killed at step {step} of {one.steps}")


def killed_at(one: Scene, moment: float) -> Iterator[Failure]:
    """When this share of the time that it takes has passed."""
    one.reset()
    after = 1.05 * moment * one.seconds
    command = Apart(one.case.new, one.folder)
    time.sleep(after)
    command.kill()
    command.ended()
    yield from judged(one, f"killed after {after:.3f} s")


def on_small_files(one: Scene) -> Iterator[Failure]:
    """Where no file can be larger than part of the largest that is written, as on a full disk."""
    largest = max(len(data) for path, data in one.new.items() if data != one.old.get(path))
    for limit in (0, largest // 2, largest - 1):
        one.reset()

        def bound(limit: int = limit) -> None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

        end = Apart(one.case.new, one.folder, bound).ended()
        yield from _refused(one, end, f"files of {limit} bytes at most", saved=False)


def on_full_disk(one: Scene) -> Iterator[Failure]:
    """On a disk that has room for nothing, or for half of what is written; root alone can make one."""
    if os.geteuid():
        return
    written = sum(len(data) for path, data in one.new.items() if data != one.old.get(path))
    disk = one.folder.parent / "disk"
    disk.mkdir(exist_ok=True)
    there = replace(one, folder=disk / "folder")
    for room in (0, _BLOCK + written // 2):
        what = f"{room} bytes left on the disk"
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=50m", "tmpfs", disk], check=True)
        try:
            there.reset()
            filled = _filled(disk, room)
            end = Apart(one.case.new, there.folder).ended()
            if end.done is None or end.done.code:  # files in blocks may have had room enough
                yield from _refused(there, end, what, saved=True)
            filled.unlink()
            yield from went_on(there, what)
        finally:
            subprocess.run(["umount", disk], check=True)


def _filled(disk: Path, room: int) -> Path:
    """A file that leaves so much room."""
    path = disk / "full"
    with path.open("wb", buffering=0) as stream, contextlib.suppress(OSError):
        while True:
            stream.write(bytes(_BLOCK))
    os.truncate(path, path.stat().st_size - room)
    return path


def on_read_only(one: Scene) -> Iterator[Failure]:
    """In folders that may be read and no more."""
    one.reset()
    places = [one.folder, *(path for path in one.folder.rglob("*") if path.is_dir())]
    for place in places:
        place.chmod(0o555)
    try:
        # What cannot be written is known before the work.
        end = Apart(one.case.new, one.folder, _become_nobody).ended()
        yield from _refused(one, end, "read-only folder", saved=False)
        if end.done is not None and end.seconds > max(0.5 * one.seconds, 0.5):
            text = f"{end.seconds:.1f} s, {one.seconds:.1f} s where it can write"
            yield Failure(kind="works before it asks", where=f"{one.name}, read-only folder", text=text)
    finally:
        for place in places:
            place.chmod(0o755)


def _become_nobody() -> None:
    """Root may write everywhere."""
    if os.geteuid() == 0:
        os.chdir("/")  # the command comes back to where it was called, which may be root's alone
        os.setgroups([])
        os.setgid(_NOBODY)
        os.setuid(_NOBODY)


def _refused(one: Scene, end: Ended, what: str, *, saved: bool) -> Iterator[Failure]:
    """One message, everything as before, and, where there is another place, the result in it."""
    where, done = f"{one.name}, {what}", end.done
    if done is None:
        yield Failure(kind="killed", where=where)
        return
    yield from (replace(failure, where=f"{where}: {failure.where}") for failure in done.failures)
    lines = done.err.removesuffix("\n").split("\n")
    if done.code != 2 or len(lines) != 1 or not lines[0].startswith("rovid: "):
        yield Failure(kind="messages", where=f"{where}, exit {done.code}", text=done.err[:300])
    if done.out:
        yield Failure(kind="stdout at exit 2", where=where, text=done.out[:200])
    now = tree(one.folder)
    if changed := sorted(path for path in one.old if now.get(path) != one.old[path]):
        yield Failure(kind="touched", where=where, text=", ".join(changed))
    if left := sorted(set(now) - set(one.old)):
        yield Failure(kind="left behind", where=where, text=", ".join(left))
    rescued = [path for path in _named(done.err) if not path.is_relative_to(one.folder)]
    if saved and not rescued:
        yield Failure(kind="result lost", where=where, text=done.err[:300])
    for path in rescued:
        shutil.rmtree(path) if path.is_dir() else path.unlink()


def _named(text: str) -> list[Path]:
    """Files and folders that a message names, and that are there."""
    return [path for found in _PATHS.findall(text) if (path := Path(found.rstrip("."))).exists()]


# Commands at once


def met(one: Scene, arguments: Sequence[Sequence[str]], number: int) -> Iterator[Failure]:
    """Run two commands at once in one folder: the files must equal the files of two consecutive runs."""
    rng = Random(number)  # noqa: S311 - nothing secret
    one.reset()
    commands = []
    for argument in arguments:
        commands.append(Apart(argument, one.folder))
        time.sleep(rng.choice((0.0, 0.0, rng.uniform(0.0, 0.3))))
    where = f"{' and '.join(' '.join(argument) for argument in arguments)}"
    for command in commands:
        done = command.ended().done
        if done is None or done.code or done.failures:
            yield Failure(kind="pair", where=where, text=str(done)[:300])
    now, allowed = tree(one.folder), in_turn(one, tuple(map(tuple, arguments)))
    if now not in allowed:
        differ = {path for each in allowed for path in {*each, *now} if each.get(path) != now.get(path)}
        yield Failure(kind="lost", where=where, text=f"pair {number}: {', '.join(sorted(differ))}")


@cache
def in_turn(one: Scene, arguments: tuple[tuple[str, ...], ...]) -> list[Tree]:
    """Files after two consecutive commands, in both orders."""
    left = []
    for order in (arguments, arguments[::-1]):
        one.reset()
        for argument in order:
            Apart(argument, one.folder).ended()
        left.append(tree(one.folder))
    return left


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.torture.faults", description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--random", type=int, default=200, metavar="KILLS", help="of all commands together")
    parser.add_argument("--pairs", type=int, default=100, help="of commands at once, of each kind")
    parser.add_argument("--only", default="", metavar="COMMAND[:FAULT]", help="as report, or plan:step 3")
    parser.add_argument("--state", type=Path, help="what is done goes here, and is not done again")
    arguments = parser.parse_args()
    state = State(arguments.state, {name: getattr(arguments, name) for name in ("seed", "random", "pairs")})
    begin = time.perf_counter()
    # The commands' folders may be read by anyone, for a command may have to be nobody's.
    with tempfile.TemporaryDirectory(prefix="faults-") as name:
        root = Path(name)
        root.chmod(0o755)
        for command in CASES:
            tried(state, command, root, arguments)
    return summary(state, time.perf_counter() - begin)


def tried(state: State, command: str, root: Path, arguments: argparse.Namespace) -> None:
    """All that can happen to ``command``."""
    only: str = arguments.only
    if only.partition(":")[0] not in {"", command} or f"{command}:all" in state.records:
        return
    rng = Random(f"{arguments.seed}/{command}")  # noqa: S311 - nothing secret
    moments = [rng.random() for _ in range(-(-arguments.random // len(CASES)))]
    one = scene(command, root)
    faults: dict[str, Callable[[Scene], Iterator[Failure]]] = {
        **{f"step {k}": partial(killed_at_step, step=k) for k in range(1, one.steps + 1)},
        "small files": on_small_files,
        "full disk": on_full_disk,
        "read-only": on_read_only,
        **{f"random {k}": partial(killed_at, moment=moment) for k, moment in enumerate(moments)},
    }
    faults |= {
        f"{pair} {k}": partial(met, arguments=both, number=k)
        for pair, (where, *both) in _PAIRS.items()
        if where == command
        for k in range(arguments.pairs)
    }
    for name, fault in ((f"{command}:{name}", fault) for name, fault in faults.items()):
        if name not in state.records and only in {"", command, name}:
            begin = time.perf_counter()
            failures = [(name, failure) for failure in fault(one)]
            state.add(name, inputs=1, failures=failures, seconds=time.perf_counter() - begin)
    if not only:
        state.add(f"{command}:all", inputs=0, failures=[], seconds=0.0)
    shutil.rmtree(one.folder.parent)


if __name__ == "__main__":
    raise SystemExit(main())
