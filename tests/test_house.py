"""The structure of the package: imports go one way, names are unique, files stay small, tests assert."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections import defaultdict
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import rovid

HOUSE = [
    "core",
    "jit",
    "trial",
    "effects",
    "faults",
    "readers",
    "model",
    "estimate",
    "diagnose",
    "planar",
    "store",
    "compare",
    "control",
    "export",
    "preflight",
    "present",
    "api",
    "app",
    "fleet",
    "cli",
]
ROOT = Path(rovid.__file__).parent
TESTS = Path(__file__).parent
# Nothing below the readers' room may be slow to import, or `rovid --help` is.
HEAVY = ("numpy", "pandas", "scipy", "numba", "matplotlib", "mcap", "rich.table")
MODULES = sorted(ROOT.rglob("*.py"))


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


def named(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def room(path: Path) -> str:
    return path.relative_to(ROOT).parts[0].removesuffix(".py")


def imported_rooms(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(parsed(path)):
        names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        found |= {name.split(".")[1] for name in names if name.startswith("rovid.")}
    return found


def test_a_module_imports_only_from_above() -> None:
    rooms = {path: own for path in MODULES if (own := room(path)) not in {"__init__", "__main__"}}
    assert set(rooms.values()) <= set(HOUSE), "a room has no place in the house"
    below = {
        named(path): names
        for path, own in rooms.items()
        if (names := {name for name in imported_rooms(path) if HOUSE.index(name) > HOUSE.index(own)})
    }
    assert not below, "modules import from rooms that stand below their own"


def test_help_imports_nothing_heavy() -> None:
    code = "import sys, rovid.cli.cli; print([m for m in sys.argv[1:] if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code, *HEAVY], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_no_class_name_has_two_owners() -> None:
    owners = defaultdict(list)
    for path in MODULES:
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.ClassDef):
                owners[node.name].append(named(path))
    shared = {name: paths for name, paths in owners.items() if len(paths) > 1}
    assert not shared, "rename all but one of each"


def test_no_module_shadows_the_standard_library() -> None:
    shadows = [named(path) for path in MODULES if path.stem in sys.stdlib_module_names]
    packages = [path.name for path in ROOT.rglob("*") if path.is_dir() and path.name in sys.stdlib_module_names]
    assert not shadows + packages


def test_files_stay_readable_in_one_sitting() -> None:
    long = {named(path): lines for path in MODULES if (lines := len(path.read_text().splitlines())) > 400}
    assert not long, "no file has more than 400 lines"
    assert len((ROOT / "diagnose" / "algorithm.py").read_text().splitlines()) <= 250


def test_modules_import_each_other_in_no_circle() -> None:
    names = {
        ".".join(("rovid", *path.relative_to(ROOT).with_suffix("").parts)).removesuffix(".__init__") for path in MODULES
    }
    graph = {}
    for path in MODULES:
        own = ".".join(("rovid", *path.relative_to(ROOT).with_suffix("").parts)).removesuffix(".__init__")
        imported = set()
        # What a function imports when it is called closes no circle.
        for node in parsed(path).body:
            if isinstance(node, ast.ImportFrom) and node.module:
                targets = {f"{node.module}.{alias.name}" for alias in node.names}
                imported |= targets if targets <= names else targets | {node.module}
        graph[own] = (imported & names) - {own}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(f"imports in a circle: {' -> '.join(error.args[1])}")


def called(function: ast.AST) -> set[str]:
    """Names that ``function`` calls, "fail" where it asserts."""
    names = set()
    for node in ast.walk(function):
        if isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            names.add("fail" if name.startswith("assert_") else name)
        elif isinstance(node, ast.Assert):
            names.add("fail")
    return names


def test_every_test_asserts() -> None:
    functions = [
        (path, node, called(node))
        for path in sorted(TESTS.rglob("*.py"))
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.FunctionDef)
    ]
    # Functions that assert, expect an exception, or call one that does.
    helpers = {"raises", "warns", "fail"}
    while more := {node.name for _, node, names in functions if not names.isdisjoint(helpers)} - helpers:
        helpers |= more
    without = [
        f"{path.relative_to(TESTS)}:{node.lineno} {node.name}"
        for path, node, _ in functions
        if node.name.startswith("test_") and node.name not in helpers
    ]
    assert not without
