"""The recipes of docs/developing.md, applied to a copy of the checkout.

Blocks are marked as in `test_docs`: a file to write, or lines to append to a file or to a list in it.
"""

from __future__ import annotations

import ast
import contextlib
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pandas as pd
import pytest
import tomli_w

from tests.conftest import ROOT, run_rovid

PAGE = (ROOT / "docs" / "developing.md").read_text(encoding="utf-8")
BLOCK = re.compile(
    r"^<!-- test: (?P<what>written|added) to (?:(?P<name>\w+) in )?(?P<path>\S+) -->\n```\w+\n(?P<text>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)
PARTS = ("rovid", "docs", "tests", "tools", "benchmarks", "sample_logs", "pyproject.toml", "README.md", "CHANGELOG.md")
DAY = ROOT / "sample_logs" / "rosub_tank"
CONFIG = """
[vehicle]
mass = 2000.0
[[thrusters]]
name = "fore"
yaw_arm = 0.43
curve = "thrust_curve.csv"
command = { logfmt = "fore_V" }
[signals]
time = { logfmt = "time_s" }
heading = { logfmt = "heading_deg", unit = "deg" }
"""


def extended(source: str, name: str, line: str) -> str:
    """``source`` with ``line`` appended to the tuple or dictionary ``name``."""
    ends = [
        (node.value.end_lineno, node.value.end_col_offset)
        for node in ast.parse(source).body
        if isinstance(node, ast.Assign | ast.AnnAssign)
        and isinstance(node.value, ast.Tuple | ast.Dict)
        and ast.unparse(node).startswith((f"{name} =", f"{name}:"))
    ]
    assert ends, f"there is no list {name}"
    row, column = ends[0]
    assert row is not None
    assert column is not None
    content = source.encode()  # columns are counted in bytes
    bracket = sum(map(len, content.splitlines(keepends=True)[: row - 1])) + column - 1
    before, after = content[:bracket].decode().rstrip(), content[bracket:].decode()
    comma = "" if before.endswith((",", "(", "{")) else ","
    return f"{before}{comma}\n    {line}{after}"


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Copy of the checkout with all additions of the page."""
    folder = tmp_path_factory.mktemp("copy")
    for part in PARTS:
        if (ROOT / part).is_dir():
            ignored = shutil.ignore_patterns("__pycache__", "parameters*.toml")
            shutil.copytree(ROOT / part, folder / part, ignore=ignored)
        else:
            shutil.copy(ROOT / part, folder / part)
    for block in BLOCK.finditer(PAGE):
        path = folder / block["path"]
        if block["what"] == "written":
            assert not path.exists(), block["path"]
            path.write_text(block["text"])
        elif block["name"]:
            path.write_text(extended(path.read_text(), block["name"], block["text"]))
        else:
            path.write_text(f"{path.read_text()}\n{block['text']}")
    return folder


def run(copy: Path, *words: str, cwd: Path | None = None, quick: bool = True, code: int = 0) -> str:
    # Allow bytecode files in the copy even if the environment disables them.
    environment = os.environ | {"PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": ""}
    if quick:
        # Compilation would take most of the time.
        environment["NUMBA_DISABLE_JIT"] = "1"
    done = subprocess.run(
        [sys.executable, *words], cwd=cwd or copy, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize(
    "source",
    ["A = (1,)\n", "A = (\n    1,\n)\n", "A = (1, 2)\nB = 3\n", "A = ()\n", "É = 1\nA: tuple[int, ...] = (1,)\n"],
)
def test_a_line_is_added_at_the_end_of_its_list(source: str) -> None:
    names: dict[str, tuple[int, ...]] = {}
    before: dict[str, tuple[int, ...]] = {}
    exec(source, before)  # noqa: S102 - a list as above
    exec(extended(source, "A", "9,\n"), names)  # noqa: S102
    assert names["A"] == (*before["A"], 9)


def test_there_is_a_recipe_for_each_extensible_room() -> None:
    written = {block["path"].rpartition("/")[0] for block in BLOCK.finditer(PAGE) if block["what"] == "written"}
    assert {"rovid/effects", "rovid/readers", "rovid/export", "rovid/cli"} <= written


def test_the_list_of_rooms_agrees_with_the_house() -> None:
    (law,) = (ROOT / "tests").rglob("test_house.py")
    house = next(
        ast.literal_eval(node.value)
        for node in ast.parse(law.read_text()).body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "HOUSE"
    )
    picture = PAGE.partition("```text\n")[2].partition("```")[0]
    assert re.findall(r"^(\w+)", picture, flags=re.MULTILINE) == house


def test_what_is_added_is_in_style(copy: Path) -> None:
    run(copy, "-m", "ruff", "check", ".")
    run(copy, "-m", "ruff", "format", "--check", ".")


@pytest.fixture(scope="module")
def identified(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with a parameter file that contains the new effect."""
    folder = tmp_path_factory.mktemp("identified")
    paper = ROOT / "sample_logs" / "rosub_paper"
    with contextlib.chdir(folder):
        for words in (("fit-drag", paper / "table3.csv"), ("fit-inertia", paper / "sine_trials.csv")):
            assert run_rovid(*words).code == 0
    path = folder / "parameters.toml"
    stored = tomllib.loads(path.read_text())
    stored["parameters"] |= {
        f"mooring_line.{name}": {"value": value, "standard_error": 0.0, "unit": unit, "method": "set"}
        for name, value, unit in (("stiffness", 40.0, "N m/rad"), ("slack", 0.5, "rad"))
    }
    path.write_text(tomli_w.dumps(stored))
    return folder


class TestEffect:
    def test_slows_the_vehicle_in_a_simulation(self, copy: Path, identified: Path, tmp_path: Path) -> None:
        # One minute only, because nothing is compiled.
        for name, rows in (("hold_01", 1200), ("thrust_curve", None)):
            pd.read_csv(DAY / f"{name}.csv", nrows=rows).to_csv(tmp_path / f"{name}.csv", index=False)
        shutil.copy(DAY / "rovid.toml", tmp_path)
        log = str(tmp_path / "hold_01.csv")
        found = json.loads(run(copy, "-m", "rovid", "simulate", log, "--json", cwd=identified))
        assert found["effects"] == ["mooring_line"]
        assert found["overall"]["yaw_rate_r2"] < 0.0

    def test_is_offered_by_completion(self, copy: Path) -> None:
        assert "mooring_line" in run(copy, "-c", "from rovid.cli import options; print(*options.effects())")

    def test_page_is_made_from_its_notes(self, copy: Path) -> None:
        code = (
            "from docs.make_effects import notes, page, picture\nfrom rovid.effects import effect_named\n"
            "effect = effect_named('mooring_line')\nprint(page(effect, notes()[effect.id]))"
        )
        text = run(copy, "-c", code)
        assert "# Line to a mooring" in text
        assert "stiffness 60 N m/rad, slack 0.5 rad" in " ".join(text.split())

    @pytest.mark.slow
    def test_keeps_all_tests_and_is_found(self, copy: Path) -> None:
        run(copy, "docs/make_effects.py", "mooring_line", quick=False)
        tests = [
            str(path) for name in ("effects", "effect_pages") for path in (copy / "tests").rglob(f"test_{name}.py")
        ]
        run(copy, "-m", "pytest", "-q", "-n", "0", *tests, quick=False)
        run(copy, "-m", "pytest", "-q", "-n", "0", "-m", "slow", "tests/effects/test_mooring_line.py", quick=False)


@pytest.mark.slow
def test_a_log_of_the_new_format_is_read(copy: Path, tmp_path: Path) -> None:
    table = pd.read_csv(DAY / "hold_03.csv")
    lines = (" ".join(f"{name}={value}" for name, value in row.items()) for row in table.to_dict("records"))
    (tmp_path / "run.logfmt").write_text("\n".join(lines))
    shutil.copy(DAY / "thrust_curve.csv", tmp_path)
    (tmp_path / "rovid.toml").write_text(CONFIG)
    found = json.loads(run(copy, "-m", "rovid", "check", ".", "--json", cwd=tmp_path))
    assert [(log["name"], log["samples"]) for log in found["logs"]] == [("run.logfmt", len(table))]
    whole = (tmp_path / "run.logfmt").read_bytes()
    for name, content in (("run", whole[: whole.rindex(b"=")]), ("empty", b""), ("picture", b"\x89PNG\r\n")):
        (tmp_path / f"{name}.logfmt").write_bytes(content)
    found = json.loads(run(copy, "-m", "rovid", "check", ".", "--json", cwd=tmp_path, code=2))
    assert f"Line {len(table)} has no pairs name=value" in json.dumps(found["logs"])
    assert [one["problem"].count("is not a file of pairs name=value") for one in found["unreadable"]] == [1, 1]


@pytest.mark.slow
def test_a_model_is_written_in_the_new_format(copy: Path, identified: Path) -> None:
    assert "plain-text" in run(copy, "-c", "from rovid.cli import options; print(*options.FIXED['formats'])")
    said = json.loads(run(copy, "-m", "rovid", "export", "plain-text", "--json", cwd=identified, quick=False))
    assert said["file"] == "plain_text.txt"
    assert said["mismatch_of_what_is_held"]["yaw_rate_percent_of_range"] == 0.0
    assert [loss["what"] for loss in said["not_held"]] == ["mooring_line"]
    assert len((identified / said["file"]).read_text().splitlines()[1].split()) == 3
    # The mark in the file allows its replacement.
    run(copy, "-m", "rovid", "export", "plain-text", cwd=identified, quick=False)


def test_a_command_runs_and_has_a_page(copy: Path) -> None:
    assert run(copy, "-m", "rovid", "axes").split()[:2] == ["yaw", "surge"]
    assert run(copy, "-m", "rovid", "axes", "--angular").split() == ["yaw", "roll", "pitch"]
    page = run(copy, "-m", "rovid", "axes", "--help")
    assert "Usage: rovid axes" in page
    assert "Rotational axes" in page
