"""Damaged logs as they come: what is wrong with them is said, and no cause or parameter is wrong because of it."""

from __future__ import annotations

import functools
import re
import shutil
import signal
import tarfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import Done, Rovid
from tests.whole.damaged_logs import LAG, TABLE, Case, Expected

CASES = Path(__file__).parent.parent / "cases"

# Comparisons of this file, some 60: one run in 250 would pass four standard errors by chance, and the logs are fixed.
SIGMAS = 4.0
# Standard errors over the truth: an error so wide that it holds everything would pass too.
WIDEST = {"inertia": 0.05, "quadratic_drag": 0.25, "linear_drag": 0.25, LAG: 0.05}
# s; an answer that takes longer is none.
PATIENCE = 120
# Units of sizes, in s, rad or 1.
UNITS = {"s": 1.0, "ms": 1e-3, "rad": 1.0, "deg": np.pi / 180.0, "": 1.0, "1": 1.0, "%": 0.01}

BY_NAME = {case.name: case for case in TABLE}
# A command that takes seconds even alone.
LONG = {
    "clocks_13ms diagnose",
    "mixed_drag_silent diagnose",
    *(f"{case.name} diagnose" for case in TABLE if LAG in case.truth),
}


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Unpack the folder of a case, once for all commands, which then read the logs once."""

    @functools.cache
    def unpack(name: str) -> Path:
        # What is asked for in messages is not to be found in the names of folders.
        top = tmp_path_factory.mktemp("case")
        with tarfile.open(CASES / f"{name.split('/', maxsplit=1)[0]}.tar.xz") as archive:
            archive.extractall(top / "cases", filter="data")
        folder = top / "cases" / name
        for part in folder.iterdir():
            if part.is_dir():  # a case of its own
                shutil.rmtree(part)
        if name == "kgf_curve":  # The rigid body's inertia shows that the thrust is impossible.
            config = folder / "rovid.toml"
            config.write_text(
                config.read_text().replace("[vehicle]", "[vehicle]\nmass = 96.0\nlength = 1.25\nwidth = 0.75")
            )
        return folder.rename(top / "logs")

    return unpack


@pytest.fixture(autouse=True)
def impatience() -> Iterator[None]:
    """A command without end is stopped."""

    def stop(*_: object) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(PATIENCE)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def assert_parameters(parameters: Mapping[str, Any], case: Case) -> None:
    for name, truth in case.truth.items():
        value, error = parameters[name]["value"], parameters[name]["standard_error"]
        assert 0.0 < error < case.widest * WIDEST[name] * truth, f"{name} {value} +- {error}, truth {truth}"
        assert abs(value - truth) < SIGMAS * error, f"{name} {value} +- {error}, truth {truth}"


def begins(log: str, prefixes: Sequence[str]) -> bool:
    return any(log.startswith(prefix) for prefix in prefixes)


def assert_fault(faults: Sequence[Mapping[str, Any]], expected: Expected) -> None:
    found = [fault for fault in faults if fault["fault"] == expected.fault]
    assert found, f"no {expected.fault} in {[fault['fault'] for fault in faults]}"
    named = sorted({log for fault in found for log in fault["logs"]})
    if expected.logs:
        assert any(
            all(begins(log, wanted) for log in named)
            and all(any(begins(log, [one]) for log in named) for one in wanted)
            for wanted in (expected.logs, expected.or_logs)
            if wanted
        ), named
    for log, at in zip(expected.logs, expected.at, strict=bool(expected.at)) if expected.at else ():
        told = [
            instant for fault in found if any(begins(one, [log]) for one in fault["logs"]) for instant in fault["at"]
        ]
        assert any(abs(instant - at) <= expected.at_within for instant in told), f"{log}: {told}, expected {at}"
    for fault in found:
        assert 0.5 < fault["confidence"] <= 1.0
        # What holds for many logs alike may be told of all together.
        assert len(fault["logs"]) > 3 or any(log in fault["text"] for log in fault["logs"]) or not fault["logs"]
        for instant in fault["at"] if expected.at else ():
            assert any(abs(instant - at) <= expected.at_within for at in expected.at), (
                f"{instant}: nothing happens there"
            )
        if expected.remedies:
            assert fault["remedy"] in expected.remedies
        if expected.size is not None:
            size = fault["size"] * UNITS[fault["unit"]]
            off = abs(abs(size) - abs(expected.size)) if expected.either_sign else abs(size - expected.size)
            assert off < expected.size_within, f"{size}, expected {expected.size}"


def assert_faults(document: Mapping[str, Any], case: Case, command: str) -> None:
    """The expected ones, and no others."""
    faults = document["faults"]
    if command in case.faults_by:
        for expected in case.faults:
            assert_fault(faults, expected)
    allowed = {expected.fault for expected in case.faults} | case.also
    assert {fault["fault"] for fault in faults} <= allowed
    assert any(fault["stops"] for fault in faults) <= (case.no_go is not False)
    assert re.search(case.says, " ".join(fault["text"] for fault in faults))


def assert_refused(done: Done, case: Case) -> None:
    """One message that says what is wrong."""
    assert done.code == 2
    assert done.err.count("rovid: ") == 1
    assert case.refused is not None, done.err
    assert re.search(case.refused, done.err), done.err


def assert_checked(done: Done, case: Case) -> None:
    document = done.document
    assert_faults(document, case, "check")
    if case.no_go is not None:
        assert (document["verdict"] == "no_go") == case.no_go
    if case.trials is not None:
        assert len(document["logs"]) == case.trials
    if case.silent:
        assert document["faults"] == []
        assert document["remarks"] == []


def assert_fitted(done: Done, case: Case) -> None:
    document = done.document
    # A fit that is known to be wrong is none.
    assert case.no_go is not True
    assert_parameters(document["parameters"], case)
    if case.samples is not None:
        assert case.samples[0] <= document["samples"] <= case.samples[1]


def assert_diagnosed(done: Done, case: Case) -> None:
    document = done.document
    assert_faults(document, case, "diagnose")
    assert document["verdict"] in case.verdicts, document["verdict"]
    assert {cause["effect"] for cause in (*document["findings"], *document["suspects"])} <= case.causes
    if document["verdict"] in {"found", "nothing_found"}:
        assert_parameters(document["extended"]["parameters"], case)


ANSWERS: Mapping[str, Callable[[Done, Case], None]] = {
    "check": assert_checked,
    "fit": assert_fitted,
    "fit-drag": assert_fitted,
    "diagnose": assert_diagnosed,
}


def expectations() -> list[Any]:
    found = []
    for case in TABLE:
        for command in case.commands:
            key = f"{case.name} {command}"
            # A fit finds the damage that a check finds.
            is_long = key in LONG or (command == "fit" and "check" in case.commands)
            marks = [pytest.mark.slow] if is_long else []
            found.append(pytest.param(case.name, command, id=key.replace(" ", "-"), marks=marks))
    return found


# What check said of a case, for the commands that follow.
_CHECKED: dict[str, Done] = {}


def ask(rovid: Rovid, name: str, command: str, logs: Callable[[str], Path]) -> Done:
    """The answer of a command on the logs of a case; a check is made once."""
    if command == "check" and name in _CHECKED:
        return _CHECKED[name]
    stored = () if command in {"check", "init"} else ("-p", "parameters.toml")
    done = rovid(command, logs(name), "--json", *stored)
    if command == "check":
        _CHECKED[name] = done
    return done


@pytest.mark.parametrize(("name", "command"), expectations())
def test_damage_is_named_and_nothing_else_is(
    name: str, command: str, logs: Callable[[str], Path], rovid: Rovid
) -> None:
    case = BY_NAME[name]
    done = ask(rovid, name, command, logs)
    if case.never:
        assert not re.search(case.never, done.out + done.err)
    if done.code == 0 and command in ANSWERS:
        ANSWERS[command](done, case)
    elif done.code != 0:
        assert_refused(done, case)
        # Faults are what check answers with, unless a log cannot be read at all.
        assert command in {"fit", "fit-drag", "init"} or not case.faults
    if command == "fit" and case.no_go is None:
        # As check says beforehand.
        assert (ask(rovid, name, "check", logs).document["verdict"] == "no_go") == (done.code != 0)


def test_no_case_is_forgotten() -> None:
    archives = {path.name.removesuffix(".tar.xz") for path in CASES.glob("*.tar.xz")}
    assert archives == {name.split("/")[0] for name in (*BY_NAME, "nested_optimum")}
    assert {f"{case.name} {command}" for case in TABLE for command in case.commands} >= LONG


@pytest.mark.slow
def test_a_larger_model_ends_no_lower(logs: Callable[[str], Path], rovid: Rovid) -> None:
    plain, delayed = (
        rovid("fit", logs("nested_optimum"), *effect, "-p", f"{len(effect)}.toml", "--json").document["log_likelihood"]
        for effect in ((), ("--effect", "command_delay"))
    )
    assert delayed >= plain
