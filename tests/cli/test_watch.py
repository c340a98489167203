"""`rovid watch` in a process of its own during a trial day."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from queue import Empty, Queue
from typing import Any

import pytest

from rovid.core.output_files import PARAMETERS, PLAN
from tests.conftest import ROOT, Rovid
from tests.store.days import RUNS, write_day
from tools.programme import CAMPAIGN
from tools.trial_day import write_trial_day

Document = dict[str, Any]
# Time limit in s for a loaded machine; no result depends on it.
PATIENCE = 120.0
QUICK = ("--interval", "0.1", "--whole", "0.5", "--cut", "2")


class Watcher:
    """A running `rovid watch --json` and its documents so far."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process
        self.said: list[Document] = []
        self._lines: Queue[str] = Queue()
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._lines.put(line)

    def until(self, wanted: Callable[[Document], bool]) -> Document:
        """The first document, past or future, that meets the condition."""
        said = next(filter(wanted, self.said), None)
        return self.next(wanted) if said is None else said

    def next(self, wanted: Callable[[Document], bool]) -> Document:
        """The next document."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            try:
                line = self._lines.get(timeout=0.2)
            except Empty:
                if self.process.poll() is not None and self._lines.empty():
                    assert self.process.stderr is not None
                    raise AssertionError((self.process.stderr.read()[-3000:], self.said[-1:])) from None
                continue
            document: Document = json.loads(line)
            assert document["schema"] == "rovid-watch/1"
            self.said.append(document)
            if wanted(document):
                return document
        raise AssertionError([document["event"] for document in self.said])

    def end(self) -> Document:
        """Interrupt the process; return its last document."""
        self.process.send_signal(signal.SIGINT)
        last = self.until(lambda document: document["event"] == "stop")
        assert self.process.wait(PATIENCE) == 0
        return last


@contextmanager
def watching(*arguments: object) -> Iterator[Watcher]:
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    command = [sys.executable, "-m", "rovid", "watch", *map(str, arguments), "--json"]
    # A shell ignores Ctrl-C for tests in the background, and a child process would inherit that.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": path}
        )
    finally:
        signal.signal(signal.SIGINT, before)
    with process:
        try:
            yield Watcher(process)
        finally:
            process.kill()


def slowly(store: Path, folder: Path, name: str, parts: int = 3) -> None:
    """Write a log in pieces, as a logger does."""
    data = (store / name).read_bytes()
    with (folder / name).open("wb") as stream:
        for part in range(parts):
            stream.write(data[part * len(data) // parts : (part + 1) * len(data) // parts])
            stream.flush()
            time.sleep(0.05)


def is_model_of(count: int) -> Callable[[Document], bool]:
    return lambda document: document["event"] == "model" and len(document["logs"]) == count


@pytest.fixture
def store(tmp_path: Path) -> Path:
    write_day(tmp_path / "store")
    return tmp_path / "store"


def begun(store: Path) -> Path:
    """The folder of the day with only rovid.toml and the thrust curve."""
    folder = store.parent / "day"
    folder.mkdir()
    for name in ("rovid.toml", "thrust_curve.csv"):
        shutil.copy(store / name, folder)
    return folder


@pytest.mark.slow
def test_the_final_result_equals_the_diagnosis_of_the_folder(store: Path, rovid: Rovid) -> None:
    first, second, *others = [f"{run.name}.csv" for run in RUNS]
    with watching("day", *QUICK) as watcher:
        watcher.until(lambda document: document["event"] == "problem")
        folder = begun(store)
        slowly(store, folder, first)
        watcher.until(is_model_of(1))
        slowly(store, folder, second)
        watcher.until(is_model_of(2))
        (folder / first).rename(folder / "first.csv")
        cut = (store / others[0]).read_text()[:-7]
        (folder / others[0]).write_text(cut)
        (folder / "empty.csv").touch()
        for name in others[1:]:
            slowly(store, folder, name)
        watcher.until(lambda document: document["event"] == "log" and document["cut"])
        watcher.until(lambda document: document["event"] == "problem" and "empty.csv" in document["where"])
        (folder / second).unlink()
        (folder / "empty.csv").unlink()
        removed = watcher.until(lambda document: document.get("action") == "removed")
        assert removed["name"] == second
        # On a loaded machine some logs may come after this one went: their diagnosis is the final one.
        left = {"first.csv", *others}
        watcher.until(lambda document: document["event"] == "suspects" and {*document["logs"]} == left)
        watcher.next(lambda document: document["event"] == "next_run")
        last = watcher.end()
    assert last["reason"] == "interrupted"
    assert last["logs"] == sorted(["first.csv", *others], key=last["logs"].index)
    assert [document["before"] for document in watcher.said if document.get("action") == "renamed"] == [first]
    whole = rovid("diagnose", folder, "-p", "other.toml", "--json").document
    for document in (last["diagnosis"], whole):
        assert document["budget"].pop("used") > 0.0  # another time in each run
    assert last["diagnosis"] == whole
    assert PLAN.matches(Path("plan.csv"))
    assert PARAMETERS.matches(Path("parameters.toml"))
    # The written file equals that of `rovid diagnose`.
    written, other = (Path(name).read_text() for name in ("parameters.toml", "other.toml"))
    assert written.partition("[parameters")[2] == other.partition("[parameters")[2]


@pytest.mark.slow
def test_the_session_stops_when_the_criteria_are_met(store: Path, rovid: Rovid) -> None:
    names = [f"{run.name}.csv" for run in RUNS]
    prefix = begun(store)
    best = 0
    for count, name in enumerate(names, 1):
        shutil.copy(store / name, prefix)
        fit = rovid("fit", prefix, "-p", f"{count}.toml", "--json")
        row = fit.document["parameters"]["quadratic_drag"]
        if max(abs(end - row["value"]) for end in row["interval_95"]) <= 0.05 * row["value"]:
            best = count
            break
    assert 1 < best < len(names), "these logs do not tell one stop from another"
    prefix.rename(store.parent / "prefix")
    folder = begun(store)
    with watching("day", *QUICK, "--no-diagnosis", "--until", "quadratic drag 5 %") as watcher:
        stopped = threading.Event()

        def played() -> None:
            for name in names:
                if not stopped.is_set():
                    slowly(store, folder, name)

        player = threading.Thread(target=played)
        player.start()
        last = watcher.until(lambda document: document["event"] == "stop")
        stopped.set()
        player.join()
        assert watcher.process.wait(PATIENCE) == 0
    assert last["reason"] == "reached"
    assert all(one["met"] for one in last["until"])
    assert best <= len(last["logs"]) <= best + 2


@pytest.mark.slow
def test_the_contribution_of_each_log_is_printed(store: Path, rovid: Rovid) -> None:
    folder = begun(store)
    with watching("day", *QUICK, "--no-diagnosis") as watcher:
        for count, run in enumerate(RUNS[:3], 1):
            slowly(store, folder, f"{run.name}.csv")
            model = watcher.until(is_model_of(count))
        watcher.end()
    row = model["parameters"]["inertia"]
    assert row["before"]["value"] > 0.0
    assert row["narrower"] > 1.0
    (low, high), (before_low, before_high) = row["interval_95"], row["before"]["interval_95"]
    assert row["narrower"] == pytest.approx((before_high - before_low) / (high - low))
    assert model["fit"]["schema"] == "rovid-fit/1"
    runs = [document for document in watcher.said if document["event"] == "next_run"]
    assert all(run["command_file"] == "plan.csv" and run["commands"]["time_s"] for run in runs)


@pytest.mark.parametrize("width", [60, 80, 120])
def test_output_fits_any_width(width: int, store: Path, rovid: Rovid, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    done = rovid("watch", store, "--once", "--no-diagnosis", "--until", "inertia 2 %, linear_drag 1 %")
    assert (done.code, done.err) == (0, "")
    assert max(map(len, done.out.splitlines())) <= width
    words = " ".join(done.out.split())
    assert "Logs: 5 logs" in words
    assert "inertia 2 %: reached" in words
    assert "Next:" in words


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("store", "--until", "inertai 2 %"), "'inertia'"),
        (("store", "--until", "thruster_lag 90 %", "--no-diagnosis"), "needs a diagnosis"),
        (("store", "-o", "notes.csv"), "already exists, and is not a command file"),
        (("store", "-o", "store/sine.csv"), "is an input of this command"),
        (("notes.csv",), "a folder was expected"),
        (("empty", "--once"), "holds no log"),
        (("gone", "--once"), "is not there"),
    ],
)
def test_a_user_error_gives_one_message(
    arguments: tuple[str, ...], said: str, store: Path, rovid: Rovid, tmp_path: Path
) -> None:
    (tmp_path / "notes.csv").write_text("mine\n")
    (tmp_path / "empty").mkdir()
    done = rovid("watch", *arguments)
    assert done.code == 2
    assert said in done.err
    assert done.err.count("\n") == 1
    assert (tmp_path / "notes.csv").read_text() == "mine\n"


@pytest.mark.slow
def test_a_whole_day_of_fifteen_logs(tmp_path: Path, rovid: Rovid) -> None:
    store, names = tmp_path / "store", [run.name for run in CAMPAIGN[:15]]
    write_trial_day(store, seed=7, campaign=CAMPAIGN[:15])
    logs = {path.stem: path.name for path in store.iterdir()}
    # Alternate the kinds of runs: each kind comes early.
    order = [logs[name] for name in sorted(names, key=lambda name: (names.index(name) * 7) % 15)]
    prefix, best, until = tmp_path / "prefix", 0, {"inertia": 0.005, "quadratic_drag": 0.016}
    shutil.copytree(store, prefix, ignore=shutil.ignore_patterns(*order))
    for count, name in enumerate(order, 1):
        shutil.copy(store / name, prefix)
        rows = rovid("fit", prefix, "-p", f"{count}.toml", "--json").document["parameters"]
        within = {one: max(abs(end - rows[one]["value"]) for end in rows[one]["interval_95"]) for one in until}
        if all(within[one] <= share * rows[one]["value"] for one, share in until.items()):
            best = count
            break
    print(f"best: {best} of 15")
    assert 0 < best < 14
    text = ", ".join(f"{name} {100.0 * share:g} %" for name, share in until.items())
    for arguments in ((), ("--until", text)):
        shutil.rmtree(tmp_path / "day", ignore_errors=True)
        folder = begun(store)
        with watching("day", *QUICK, "-p", f"day{len(arguments)}.toml", *arguments) as watcher:
            for count, name in enumerate(order, 1):
                if watcher.process.poll() is not None:
                    break
                slowly(store, folder, name, parts=6)
                if count == 4:
                    (folder / order[0]).rename(folder / f"again_{order[0]}")
                if count == 6:
                    data = (store / order[5]).read_bytes()
                    (folder / order[5]).write_bytes(data[: len(data) * 4 // 5 + 3])
                if count == 9 and not arguments:
                    (folder / order[2]).unlink()
                taken = count - (count >= 9 and not arguments)
                done = watcher.until(
                    lambda document, taken=taken: (
                        document["event"] == "stop"  # type: ignore[misc]  # a default
                        or (document["event"] == "model" and len(document["logs"]) == taken)
                    )
                )
                if done["event"] == "stop":
                    break
            if arguments:
                assert done["event"] == "stop"
                assert done["reason"] == "reached"
                print(f"stopped after {len(done['logs'])}")
                assert best <= len(done["logs"]) <= best + 2
                continue
            watcher.until(lambda document: document["event"] == "suspects" and len(document["logs"]) == 14)
            last = watcher.end()
        whole = rovid("diagnose", folder, "-p", "other.toml", "--json").document
    for document in (last["diagnosis"], whole):
        assert document["budget"].pop("used") > 0.0  # another time in each run
    assert last["diagnosis"] == whole
