"""Data flows one way, and what each module does is tested where one looks for it."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import rovid

HOUSE = [
    "ground",
    "campaign",
    "readers",
    "effects",
    "motion",
    "model",
    "identify",
    "plan",
    "diagnose",
    "parameters",
    "study",
    "compare",
    "watch",
    "control",
    "export",
    "inspect",
    "show",
    "report",
    "app",
    "fleet",
    "commands",
]
ROOT = Path(rovid.__file__).parent
TESTS = Path(__file__).parent
# Nothing below the readers' room may be slow to import, or `rovid --help` is.
HEAVY = ("numpy", "pandas", "scipy", "numba", "matplotlib", "mcap", "rich.table")
# Folders of one file a thing, and the test that goes through all of them, so that a new one is tested by being there.
TOGETHER = {
    "effects": "effects/test_effects.py",
    "export": "export/test_formats.py",
    "commands": "commands/test_manual.py",
    "ground/files": "ground/test_files.py",
    "model/kernels": "model/test_kernels.py",
    "report/plots": "report/test_plots.py",
}
# Modules without a test of their own, and why.
WITHOUT = {
    "ground/arrays.py": "names of types",
    "ground/compiled.py": "settings",
    "model/acting.py": "a record",
    "campaign/formats.py": "a list",
    "report/evidence.py": "a record",
    "diagnose/record.py": "records",
    # What a diagnosis says follows from all of its steps; it is held against truth by `whole/test_causes.py`.
    "diagnose/experiments.py": "a step of the diagnosis",
    "diagnose/signals.py": "a step of the diagnosis",
    "diagnose/waves.py": "a step of the diagnosis",
    "diagnose/work.py": "a step of the diagnosis",
}
MODULES = sorted(ROOT.rglob("*.py"))


def named(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def room(path: Path) -> str:
    return path.relative_to(ROOT).parts[0].removesuffix(".py")


def imported_rooms(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        found |= {name.split(".")[1] for name in names if name.startswith("rovid.")}
    return found


@pytest.mark.parametrize("path", MODULES, ids=named)
def test_a_module_imports_only_from_above(path: Path) -> None:
    own = room(path)
    if own in {"__init__", "__main__"}:
        return
    assert own in HOUSE, f"{own} has no place in the house"
    below = {name for name in imported_rooms(path) if HOUSE.index(name) > HOUSE.index(own)}
    assert not below, f"{own} imports from {below}, which stand below it"


def test_help_imports_nothing_heavy() -> None:
    code = "import sys, rovid.commands.cli; print([m for m in sys.argv[1:] if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code, *HEAVY], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def place_of(path: Path) -> Path:
    """Where the tests of a module are looked for."""
    inside = path.relative_to(ROOT)
    together = TOGETHER.get(inside.parent.as_posix())
    return TESTS / (together or inside.parent / f"test_{inside.name}")


@pytest.mark.parametrize("path", [path for path in MODULES if not path.stem.startswith("__")], ids=named)
def test_a_module_has_a_test_file_of_its_name(path: Path) -> None:
    found = place_of(path)
    if named(path) in WITHOUT:
        assert not found.exists(), f"{named(path)} has tests: take it off the list"
        return
    wanted = found.relative_to(TESTS.parent)
    assert found.exists(), f"write {wanted}, or say among those without one why {named(path)} needs none"


def test_what_is_without_a_test_is_there() -> None:
    gone = [name for name in WITHOUT if not (ROOT / name).exists()]
    assert not gone
