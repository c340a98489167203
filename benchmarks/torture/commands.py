"""Run one command on one input, as a user would, and judge the result."""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import resource
import shlex
import shutil
import sys
import time
import tomllib
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import rovid
from benchmarks.torture.frames import dataflash_ends, sentence_ends, table_ends, tlog_ends, ulog_ends
from benchmarks.torture.mutations import Case, mutated
from benchmarks.torture.samples import FORMATS, Sample, samples
from rovid.cli import cli
from rovid.core.errors import RovidError
from rovid.trial.config import load_config

# Beyond what the process has, and four times what is needed of the file.
MEMORY = 300_000_000
CUT = "cut"
_ROOT = Path(rovid.__file__).parent
_PAGE = resource.getpagesize()
_TARGETS = ("out.csv", "out.mcap", "out.parquet")
_EXPORTS = ("json", "gz-sim", "uuv", "matlab")
# A table for every so many documents: both are printed, and a table takes as long as the reading.
_TABLE_EVERY = 8
_LONGEST_MESSAGE = 4000
# A terminal obeys these; a tab and a line's end are text.
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
_WITH_STDOUT = {"check"}  # says what is in the logs that can be read, whatever is wrong with the others


@dataclass(frozen=True, kw_only=True)
class Input:
    """What is to be tried: ``number`` is that of a mutation, or "cut" and how many bytes are left."""

    format: str
    command: str
    number: str

    def __str__(self) -> str:
        return f"{self.format}:{self.command}:{self.number}"

    def case(self, seed: int) -> Case:
        """What is put into the folder."""
        if self.number.startswith(CUT):
            sample = samples(self.format)[0]
            return Case(sample=sample, name=sample.name, data=sample.data[: int(self.number.removeprefix(CUT))])
        return mutated(self.format, seed, self.command, int(self.number))


@dataclass(frozen=True, kw_only=True)
class Failure:
    """What must not be: its kind, where in the code or about what, and what was said."""

    kind: str
    where: str
    text: str = ""


@dataclass(frozen=True, kw_only=True)
class Done:
    """How a command ended, what it printed, and what must not be, as far as that shows on the way."""

    code: int
    out: str
    err: str
    failures: tuple[Failure, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Result:
    """What came of an input."""

    code: int
    seconds: float
    failures: tuple[Failure, ...] = field(default=())


def run(arguments: Sequence[object], folder: Path) -> Done:
    """`rovid` with ``arguments`` in ``folder``."""
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8", errors=e) for e in ("strict", "backslashreplace"))
    code: int = 0
    failures: list[Failure] = []

    def noted(message: Warning | str, category: type[Warning], *_: object, **__: object) -> None:
        failures.append(_located("warning", category.__name__, str(message), traceback.extract_stack()))

    argv, sys.argv = sys.argv, ["rovid", *map(str, arguments)]
    try:
        # Python shows a warning once a place, unless the filters are set anew: each input has to show its own.
        with warnings.catch_warnings(), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            warnings.showwarning = noted
            with contextlib.chdir(folder):
                cli.main()
                out.flush()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
        if code not in {0, 2}:
            failures.append(Failure(kind="exit code", where=f"{arguments[0]}: {code}"))
    except Exception as error:  # noqa: BLE001 - this is what is looked for
        failures.append(_traceback(error))
        code = 1
    finally:
        sys.argv = argv
    texts = []
    for stream in (out, err):
        with contextlib.suppress(UnicodeEncodeError):
            stream.flush()
        texts.append(stream.buffer.getvalue().decode("utf-8", errors="replace"))
        stream.detach()
    return Done(code=code, out=texts[0], err=texts[1], failures=tuple(failures))


def _traceback(error: BaseException) -> Failure:
    return _located("traceback", type(error).__name__, str(error), traceback.extract_tb(error.__traceback__))


def _located(kind: str, name: str, text: str, frames: Sequence[traceback.FrameSummary]) -> Failure:
    """With the innermost place in rovid itself."""
    own = [frame for frame in frames if Path(frame.filename).is_relative_to(_ROOT)]
    last = own[-1] if own else frames[-1]
    file = Path(last.filename).relative_to(_ROOT) if own else last.filename
    return Failure(kind=kind, where=f"{name} at {file}:{last.lineno} {last.name}", text=text[:300])


def located(stack: str) -> str:
    """The innermost place in rovid itself, of the first stack that faulthandler wrote."""
    for line in stack.partition("\n\n")[0].splitlines():
        if found := re.search(r'File "([^"]+)", line (\d+) in (\w+)', line):
            path = Path(found[1])
            if path.is_relative_to(_ROOT):
                return f"{path.relative_to(_ROOT)}:{found[2]} {found[3]}"
    return ""


class Place:
    """Folders for the inputs, each with the other files that the inputs need."""

    def __init__(self, root: Path) -> None:
        self.root = root
        # Result of `rovid check` for the undamaged first sample of each format.
        self._said: dict[str, Any] = {}
        self._folders: dict[tuple[str, str, str], tuple[Path, frozenset[str]]] = {}

    def tried(self, one: Input, seed: int) -> Result:
        """Put the input into its folder, run the command and judge."""
        return self._tried(one, one.case(seed))

    def whole(self, name: str, command: str) -> None:
        """Assert that every sample is read as it is, where it is to be changed."""
        for number, sample in enumerate(samples(name)):
            if FORMATS[name].changed == "nothing":
                continue
            one = Input(format=name, command=command, number=str(number))
            result = self._tried(one, Case(sample=sample, name=sample.name, data=sample.data))
            assert result.code == 0, f"{name}:{command}: sample {number} is refused"
            assert not result.failures, f"{name}:{command}: sample {number}: {result.failures}"

    def _tried(self, one: Input, case: Case) -> Result:
        whole = self._whole_document(one) if one.number.startswith(CUT) else None
        folder, path, there = self._laid(one, case)
        arguments = _arguments(one, path)
        before, highest, said = resident(), peak(), _printed()
        begun = time.perf_counter()
        done = run(arguments, folder)
        seconds = time.perf_counter() - begun
        failures = [*done.failures]
        # A peak that was there before says nothing of this input.
        if peak() > max(highest, before + MEMORY + 4 * case.sample.needed):
            failures.append(Failure(kind="memory", where=one.command, text=f"{(peak() - before) / 1e6:.0f} MB"))
        if _printed() > said:
            failures.append(Failure(kind="messages", where=f"{one.command}: a library prints by itself"))
        if done.code in {0, 2}:
            failures += judged(one, done, arguments)
        if not done.code:
            failures += _written(one, folder, arguments)
            if one.number.startswith(CUT):
                failures += _loss_said(case, whole, done)
        path.unlink()
        failures += _cleared(one, folder, there, done.code)
        return Result(code=done.code, seconds=seconds, failures=tuple(failures))

    def shown(self, one: Input, seed: int) -> Result:
        """As ``tried``, with all that is printed, and where to do it by hand; the input stays there."""
        case = one.case(seed)
        folder, path, _ = self._laid(one, case)
        print(f"cd {shlex.quote(str(folder))}; rovid {shlex.join(map(str, _arguments(one, path)))}")
        result = self._tried(one, case)
        self._laid(one, case)
        print(run(_arguments(one, path), folder))
        return result

    def _laid(self, one: Input, case: Case) -> tuple[Path, Path, frozenset[str]]:
        """The folder with the input in it, the input's path, and the names of what else belongs there."""
        folder, there = self._folder(one, case.sample)
        path = folder / case.name
        path.write_bytes(case.data)
        return folder, path, there

    def _whole_document(self, one: Input) -> Any:
        """What is said of the whole file that ``one`` is cut from; None where nothing is said of files."""
        if one.command != "check":
            return None
        if one.format not in self._said:
            sample = samples(one.format)[0]
            folder, _ = self._folder(one, sample)
            path = folder / sample.name
            path.write_bytes(sample.data)
            self._said[one.format] = json.loads(run(_arguments(one, path), folder).out)
            path.unlink()
        return self._said[one.format]

    def _folder(self, one: Input, sample: Sample) -> tuple[Path, frozenset[str]]:
        """The folder of one sample and command, and the names of what belongs there."""
        key = one.format, one.command, str(id(sample))
        if key not in self._folders:
            folder = self.root / "-".join(key)
            folder.mkdir(parents=True)
            beside = {k: v for k, v in sample.beside.items() if k != "rovid.toml" or one.command != "init"}
            for name, data in beside.items():
                (folder / name).write_bytes(data)
            self._folders[key] = folder, frozenset(beside)
        return self._folders[key]


def _arguments(one: Input, path: Path) -> list[object]:
    at = int(one.number.removeprefix(CUT))
    # A cut is said among the remarks of the document.
    json_wanted = ["--json"] if one.number.startswith(CUT) or at % _TABLE_EVERY else []
    log = path.name if path.suffix.lower() != ".toml" else "dive.csv"
    arguments: Mapping[str, list[object]] = {
        "check": [path.parent if at % 2 else "."],
        "init": ["."],
        "convert": [log, "-o", _TARGETS[at % len(_TARGETS)]],
        "simulate": [],
        "export": [_EXPORTS[at % len(_EXPORTS)], "-o", "model" + _SUFFIXES[at % len(_EXPORTS)]],
        "fit-thruster": [path.name, "-o", "fitted.csv"],
        "fit-drag": [path.name, "-p", "fitted.toml"],
    }
    return [one.command, *arguments[one.command], *json_wanted]


_SUFFIXES = (".json", ".sdf", ".xacro", ".m")


def judged(one: Input, done: Done, arguments: Sequence[object]) -> Iterator[Failure]:
    """What must not be in what was printed."""
    if done.code == 2:
        lines = done.err.removesuffix("\n").split("\n")
        if len(lines) != 1 or not lines[0].startswith("rovid: "):
            yield Failure(kind="messages", where=f"{one.command}: {len(lines)} lines", text=done.err[:300])
        if len(done.err) > _LONGEST_MESSAGE:
            yield Failure(kind="long message", where=one.command, text=f"{len(done.err)} characters: {done.err[:200]}")
        if done.out and one.command not in _WITH_STDOUT:
            yield Failure(kind="stdout at exit 2", where=one.command, text=done.out[:300])
    elif stray := [line for line in done.err.split("\n") if line and not line.startswith("Note: ")]:
        yield Failure(kind="messages", where=f"{one.command} at exit 0", text=stray[0][:300])
    for name, text in (("stdout", done.out), ("stderr", done.err)):
        if found := _CONTROL.search(text):
            around = text[max(found.start() - 40, 0) : found.end() + 40]
            yield Failure(kind="control character", where=f"{one.command} {name}", text=repr(around))
    if "--json" in arguments and done.out:
        try:
            json.loads(done.out)
        except ValueError as error:
            yield Failure(kind="no JSON", where=one.command, text=f"{error}: {done.out[:200]}")


def _written(one: Input, folder: Path, arguments: Sequence[object]) -> Iterator[Failure]:
    """What was written has to be there, and rovid has to read it."""
    if one.command == "init":
        try:
            load_config(folder / "rovid.toml")
        except RovidError as error:
            if "# OPEN: no column was recognised" in (folder / "rovid.toml").read_text(encoding="utf-8"):
                return  # and says so
            yield Failure(kind="writes what it refuses", where="init", text=str(error)[:300])
        except Exception as error:  # noqa: BLE001 - this is what is looked for
            yield _traceback(error)
    for k, argument in enumerate(arguments[:-1]):
        if argument in {"-o", "-p"} and not (folder / str(arguments[k + 1])).stat().st_size:
            yield Failure(kind="empty output", where=one.command)
    if one.command == "fit-drag":
        tomllib.loads((folder / "fitted.toml").read_text())


def _loss_said(case: Case, whole: Any, done: Done) -> Iterator[Failure]:
    """Where a cut shows and takes measurements with it, that has to be said."""
    if whole is None or len(case.data) in shows_nothing(case.sample):
        return
    document = json.loads(done.out)
    less = [log["samples"] for log in document["logs"]] != [log["samples"] for log in whole["logs"]]
    if less and not document["remarks"] and not any(log["remarks"] for log in document["logs"]):
        yield Failure(kind="silent loss", where=case.name, text=f"{len(case.data)} of {len(case.sample.data)} bytes")


def shows_nothing(sample: Sample) -> frozenset[int]:
    """Lengths at which nobody can know that there was more."""
    suffix = Path(sample.name).suffix.lower()
    return _ENDS[suffix](sample.data) if suffix in _ENDS else frozenset()


_ENDS: Mapping[str, Callable[[bytes], frozenset[int]]] = {
    ".csv": table_ends,
    ".nmea": sentence_ends,
    ".bin": dataflash_ends,
    ".tlog": tlog_ends,
    ".ulg": ulog_ends,
}


def _cleared(one: Input, folder: Path, there: frozenset[str], code: int) -> Iterator[Failure]:
    """Take away what the command wrote; after exit 2 there must be nothing."""
    new = {path.name for path in folder.iterdir()} - there
    wanted = {"rovid.toml", "thrust_guess.csv"} if one.command == "init" else {"fitted.csv", "fitted.toml"}
    wanted |= {*_TARGETS, *(f"model{suffix}" for suffix in _SUFFIXES)}
    for name in new:
        path = folder / name
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()
    if left := sorted(new if code else new - wanted):
        yield Failure(kind="left behind", where=one.command, text=", ".join(left))


def resident() -> int:
    """Bytes of memory in use."""
    with open("/proc/self/statm", "rb") as stream:  # noqa: PTH123 - for each of a million inputs
        return int(stream.read().split()[1]) * _PAGE


def peak() -> int:
    """The most bytes of memory that were ever in use."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def _printed() -> int:
    """What libraries wrote without asking Python: a worker's own output goes to a file."""
    return os.fstat(1).st_size
