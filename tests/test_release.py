"""What a release says of itself, and that it reads what the one before it wrote."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import yaml

from rovid import __version__
from rovid.store.load import read_parameters

ROOT = Path(__file__).resolve().parents[1]
RELEASED = re.findall(r"^## \[(\d+\.\d+\.\d+)\] - (\S+)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
# By 0.1.0, of the founding paper's table of steady turns.
OLD = """
schema = "rovid-parameters/1"
rovid_version = "0.1.0"
written = 2026-11-21 18:00:00+00:00
vehicle = "ROSUB 6000"
logs = ["table3.csv"]

[parameters.inertia]
value = 5057.0
standard_error = 12.5
unit = "kg m^2"
method = "orbit integral over whole periods"

[parameters.quadratic_drag]
value = 3490.0
standard_error = 33.0
unit = "N m s^2/rad^2"
method = "steady turns, weighted least squares"

[parameters."thruster_lag.time_constant"]
value = 0.3
standard_error = 0.01
unit = "s"
method = "maximum likelihood"

[covariance]
names = ["inertia", "quadratic_drag", "thruster_lag.time_constant"]
matrix = [[156.25, 0.0, 0.0], [0.0, 1089.0, 0.0], [0.0, 0.0, 0.0001]]

[[sources]]
name = "table3.csv"
sha256 = "00"
samples = 12
"""


def test_version_and_date_are_the_same_everywhere() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert (citation["version"], str(citation["date-released"])) == RELEASED[0]
    assert __version__ == RELEASED[0][0]


def test_releases_stand_from_the_newest_to_the_oldest() -> None:
    numbers = [tuple(map(int, version.split("."))) for version, _ in RELEASED]
    assert numbers == sorted(set(numbers), reverse=True)


def test_parameters_of_the_first_release_are_read(tmp_path: Path) -> None:
    path = tmp_path / "parameters.toml"
    path.write_text(OLD)
    stored = read_parameters(path)
    assert {name: entry.value for name, entry in stored.entries.items()} == {
        "inertia": 5057.0,
        "quadratic_drag": 3490.0,
        "thruster_lag.time_constant": 0.3,
    }
    assert [effect.key for effect in stored.model().effects] == ["thruster_lag"]


def test_the_page_on_licences_has_every_dependency_and_names_the_copyleft_ones() -> None:
    page = (ROOT / "docs" / "licences.md").read_text(encoding="utf-8")
    listed = dict(re.findall(r"^\| (\S+) \| \S+ \| (.+) \|$", page, re.MULTILINE))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    groups = [project["dependencies"], *project["optional-dependencies"].values()]
    direct = {re.split(r"[\[<>=]", text)[0] for texts in groups for text in texts} - {"rovid"}
    assert direct < set(listed)
    assert {"llvmlite", "kiwisolver"} < set(listed)  # what these need in turn
    assert [name for name, licence in listed.items() if "GPL" in licence] == ["pymavlink"]
    assert "copyleft licence: pymavlink" in page
