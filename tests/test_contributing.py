"""What a contributor is told to do, and asked for, is there."""

from __future__ import annotations

import os
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
FORMS = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("[!c]*.yml"))


def read(path: Path) -> Any:
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def test_the_workflow_is_the_continuous_integration_of_everybody() -> None:
    jobs = read(ROOT / ".github" / "workflows" / "tests.yml")["jobs"]
    assert jobs.pop("notebooks")["steps"][-1]["run"] == "make notebooks"
    (job,) = jobs.values()
    assert [step["run"] for step in job["steps"] if "run" in step] == [".ci/run"]
    assert os.access(ROOT / ".ci" / "run", os.X_OK)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert job["strategy"]["matrix"]["python"][0] == project["requires-python"].removeprefix(">=")


def test_the_hooks_are_what_make_lint_runs() -> None:
    (repository,) = read(ROOT / ".pre-commit-config.yaml")["repos"]
    recipe = (ROOT / "Makefile").read_text().partition("\nlint:")[2].partition("\n\n")[0]
    linters = [line.strip().replace("$(BIN)", ".venv/bin") for line in recipe.splitlines()[1:]]
    wanted = [line.replace(" --check", "").removesuffix(" .") for line in linters]
    assert [hook["entry"] for hook in repository["hooks"]] == wanted


@pytest.mark.parametrize("path", FORMS, ids=lambda path: path.stem)
def test_a_form_asks_for_what_is_needed(path: Path) -> None:
    form = read(path)
    assert form["name"]
    assert form["description"]
    asked = {field["id"]: field for field in form["body"]}
    assert {"version", "configuration"} < set(asked)
    needed = {name for name, field in asked.items() if field.get("validations", {}).get("required")}
    assert len(needed) >= 4
    assert all(field["attributes"]["label"] and field["attributes"]["description"] for field in asked.values())


def test_what_is_linked_and_named_is_there() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text()
    assert [link for link in re.findall(r"\]\(([^)]+)\)", text) if not (ROOT / link).exists()] == []
    targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert set(re.findall(r"`make ([\w-]+)`", text)) <= set(targets)
    assert len(FORMS) == 2
