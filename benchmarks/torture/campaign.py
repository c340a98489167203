"""Every command that writes, with what stands there before: for kills, full disks, and commands at once."""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.torture.commands import run

_SAMPLES = Path(__file__).parents[2] / "sample_logs"
# Enough for every fit, and short.
_LOGS = ("hold_01.csv", "hold_02.csv", "hold_03.csv", "hold_04.csv", "hold_05.csv", "sine_40s_a.csv")
_MOMENT = re.compile(rb"\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(?:\.\d+)?(?:Z|[+-]\d\d:?\d\d)?")

Tree = Mapping[str, bytes]


@dataclass(frozen=True, kw_only=True)
class Case:
    """A command that writes.

    Attributes
    ----------
    old, new
        The same command, with other results; an empty ``old``: nothing stands there yet.
    needs
        The parameters that have to be known.
    again
        What a user does next, where it is not the same once more.
    """

    new: Sequence[str]
    old: Sequence[str] = ()
    needs: Sequence[Sequence[str]] = ()
    again: Sequence[str] = ()


_DRAG, _INERTIA = ("fit-drag", "L"), ("fit-inertia",)
_PAGE = ("report", "--no-diagnosis", "--no-control", "--no-export")
CASES: Mapping[str, Case] = {
    "init": Case(new=("init", "I"), again=("init", "I", "--force")),
    "convert": Case(new=("convert", "L/hold_01.csv", "-o", "out/dive.mcap")),
    "fit-thruster": Case(new=("fit-thruster", "B.csv", "-o", "c.csv"), old=("fit-thruster", "A.csv", "-o", "c.csv")),
    "fit-drag": Case(new=_DRAG, old=(*_DRAG, "--cutoff", "0.3")),
    "fit-inertia": Case(new=_INERTIA, old=(*_INERTIA, "--cutoff", "0.3"), needs=[_DRAG]),
    "fit": Case(new=("fit", "L"), old=("fit", "L", "--cutoff", "0.3")),
    "plan": Case(new=("plan",), old=("plan", "--share", "0.5"), needs=[_DRAG, _INERTIA]),
    "control": Case(
        new=("control", "--c", "c.c", "--python", "p.py"),
        old=("control", "--c", "c.c", "--python", "p.py", "--damping", "0.9"),
        needs=[_DRAG, _INERTIA],
    ),
    "export": Case(new=("export", "json"), old=("export", "json", "-p", "other.toml"), needs=[_DRAG, _INERTIA]),
    "simulate": Case(
        new=("simulate", "--mcap", "M"), old=("simulate", "--mcap", "M", "-p", "other.toml"), needs=[_DRAG, _INERTIA]
    ),
    "report": Case(new=_PAGE, old=(*_PAGE, "-p", "other.toml"), needs=[_DRAG, _INERTIA]),
}


def laid_out(folder: Path, case: Case) -> None:
    """Write the logs into ``folder``, and have rovid write what the case wants to be there."""
    logs = folder / "L"
    logs.mkdir(parents=True)
    for name in ("rovid.toml", "thrust_curve.csv", *_LOGS):
        shutil.copy(_SAMPLES / "rosub_tank" / name, logs)
    (folder / "I").mkdir()
    shutil.copy(_SAMPLES / "rosub_tank" / "hold_01.csv", folder / "I")
    for name, sample in (("A.csv", "kaxan_520.csv"), ("B.csv", "kaxan_540.csv")):
        shutil.copy(_SAMPLES / "thruster_bench" / sample, folder / name)
    if "other.toml" in case.old:
        must((*_DRAG, "-p", "other.toml", "--cutoff", "0.3"), folder)
        must((*_INERTIA, "-p", "other.toml"), folder)
    for arguments in (*case.needs, case.old):
        if arguments:
            must(arguments, folder)


def must(arguments: Sequence[str], folder: Path) -> None:
    """Run a command that must succeed."""
    done = run(arguments, folder)
    assert (done.code, done.failures) == (0, ()), f"{' '.join(arguments)}: {done}"


def tree(folder: Path) -> Tree:
    """Every file under ``folder``, without the time stamps in the files."""
    return {
        str(path.relative_to(folder)): _MOMENT.sub(b"", path.read_bytes())
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def restore(folder: Path, kept: Path) -> None:
    """Put ``folder`` back as it was ``kept``."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(kept, folder, symlinks=True)
