"""Data flows one way, and what each module does is tested where one looks for it."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import rovid

HOUSE = [
    "core",
    "jit",
    "trial",
    "readers",
    "signals",
    "effects",
    "model",
    "estimate",
    "design",
    "diagnose",
    "store",
    "compare",
    "watch",
    "control",
    "export",
    "preflight",
    "present",
    "app",
    "fleet",
    "cli",
]
ROOT = Path(rovid.__file__).parent
TESTS = Path(__file__).parent
# Nothing below the readers' room may be slow to import, or `rovid --help` is.
HEAVY = ("numpy", "pandas", "scipy", "numba", "matplotlib", "mcap", "rich.table")
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
    code = "import sys, rovid.cli.cli; print([m for m in sys.argv[1:] if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code, *HEAVY], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
