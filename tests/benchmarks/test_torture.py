"""The torture sees what must not be; and a small share of it, the same inputs each time, is survived."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from benchmarks.torture import apart
from benchmarks.torture.commands import Done, Input, Place, Result, judged, shows_nothing
from benchmarks.torture.frames import sealed_nmea, sealed_tlog
from benchmarks.torture.mutations import mutated
from benchmarks.torture.pool import Batch, tried
from benchmarks.torture.samples import FORMATS, samples
from benchmarks.torture.state import State
from tests.conftest import ROOT

GOOD = '{"logs": []}'


class Deadly(Place):
    """Instead of a command: what the number of the input says."""

    def whole(self, name: str, command: str) -> None:
        del name, command

    def tried(self, one: Input, seed: int) -> Result:
        number = int(one.number)
        if number == 1:
            while True:
                sum(range(1000))
        if number == 3:
            os.abort()
        if number == 4:
            os._exit(0)
        return Result(code=seed, seconds=0.0)


@pytest.mark.slow
def test_workers_that_hang_or_die_are_replaced_and_what_they_were_at_is_said() -> None:
    batch = Batch(format="csv", command="check", cut=False, numbers=range(6))
    (done,) = tried([batch], seed=7, jobs=1, longest=0.5, kind=Deadly)
    kinds = [[failure.kind for failure in result.failures] for result in done.results]
    assert kinds == [[], ["hang"], [], ["crash"], ["crash"], []]
    assert [result.code for result in done.results if not result.failures] == [7, 7, 7]


def test_an_input_is_told_by_its_seed_and_number() -> None:
    for name, form in FORMATS.items():
        same, again, other = (mutated(name, seed, form.commands[0], 5) for seed in (1, 1, 2))
        assert same == again
        assert (same != other) == (form.changed != "nothing"), name


@pytest.mark.parametrize(
    ("done", "kinds"),
    [
        (Done(code=0, out=GOOD, err=""), []),
        (Done(code=0, out=GOOD, err="Note: slowly.\n"), []),
        (Done(code=2, out="", err="rovid: a: is no log.\n"), []),
        (Done(code=0, out=GOOD, err="something\n"), ["messages"]),
        (Done(code=2, out="", err="rovid: a.\nrovid: b.\n"), ["messages"]),
        (Done(code=2, out="", err=""), ["messages"]),
        (Done(code=2, out="{}", err="rovid: a.\n"), ["stdout at exit 2"]),
        (Done(code=2, out="", err=f"rovid: {'a' * 5000}.\n"), ["long message"]),
        (Done(code=2, out="", err="rovid: \x1b[31m.\n"), ["control character"]),
        (Done(code=0, out='{"a": "\x7f"}', err=""), ["control character"]),
        (Done(code=0, out="{", err=""), ["no JSON"]),
    ],
)
def test_what_a_command_prints_is_judged(done: Done, kinds: list[str]) -> None:
    one = Input(format="csv", command="convert", number="1")
    assert [failure.kind for failure in judged(one, done, ["convert", "--json"])] == kinds


def test_a_change_can_be_put_under_a_right_checksum() -> None:
    telemetry, text = samples("tlog")[0], samples("nmea")[0]
    inside = telemetry.frames[0].start
    for data, seal, at in (
        (telemetry.data, sealed_tlog, inside),
        (text.data, sealed_nmea, text.data.index(b"HDT,") + 4),
    ):
        assert seal(data) == data
        changed = data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]
        assert seal(changed) not in {data, changed}


def test_where_a_cut_cannot_show() -> None:
    for name in ("csv", "nmea", "tlog", "ulg", "bin"):
        sample = samples(name)[0]
        ends = shows_nothing(sample)
        assert 60 < len(ends) < len(sample.data) / 2, name


def test_a_run_that_was_ended_goes_on(tmp_path: Path) -> None:
    path, settings = tmp_path / "state.jsonl", {"seed": 1}
    State(path, settings).add("csv:check:0-5-1", inputs=5, seconds=1.0, failures=[])
    with path.open("a") as stream:
        stream.write('{"name": "csv:ch')
    assert list(State(path, settings).records) == ["csv:check:0-5-1"]
    State(path, settings).add("csv:init:0-5-1", inputs=5, seconds=1.0, failures=[])
    assert len([json.loads(line) for line in path.read_text().splitlines()]) == 3
    with pytest.raises(SystemExit, match="another run"):
        State(path, {"seed": 2})


# The process of a test has threads of pytest's; none of them is at anything that the new one needs.
@pytest.mark.filterwarnings("ignore:This process .* is multi-threaded:DeprecationWarning")
def test_a_command_apart_is_killed_at_a_step(tmp_path: Path) -> None:
    steps = apart.steps_in(tmp_path, lambda: os.kill(os.getpid(), 9))
    assert apart.Apart(["--version"], tmp_path, steps).ended().done is not None

    def write() -> None:
        steps()
        (tmp_path / "a").write_text("")

    assert apart.Apart(["--version"], tmp_path, write).ended().done is None
    assert not (tmp_path / "a").exists()


def survived(*arguments: str) -> None:
    """Nothing failed; what did says how to have it again."""
    command = [sys.executable, "-m", *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{done.stdout[-10_000:]}{done.stderr}"


@pytest.mark.slow
def test_a_few_inputs() -> None:
    formats = [name for name, form in FORMATS.items() if form.changed != "nothing"]
    survived("benchmarks.torture", "--inputs", "80", "--cuts", "3000", "--jobs", "1", "--formats", *formats)


@pytest.mark.parametrize("command", [pytest.param("init", marks=pytest.mark.slow), "fit-thruster:random 0"])
def test_a_few_faults(command: str) -> None:
    survived("benchmarks.torture.faults", "--only", command, "--random", "11")


@pytest.mark.slow
def test_many_inputs() -> None:
    # Others each day; a failure says which they were.
    seed = str(int(time.time()) // 86_400)
    survived("benchmarks.torture", "--seed", seed, "--inputs", "40000", "--cuts", "11")


@pytest.mark.slow
def test_many_faults() -> None:
    survived("benchmarks.torture.faults", "--random", "55", "--pairs", "10")
