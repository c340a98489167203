"""Reading of parameter files, and refused content."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from rovid.core.errors import ConfigError
from rovid.store.load import read_parameters
from tests.store.test_parameter_file import written

MATRIX = r"(?s)matrix = \[.*?\n\]"


def test_logs_that_move_with_the_file_are_found(tmp_path: Path) -> None:
    (tmp_path / "day" / "logs").mkdir(parents=True)
    written(tmp_path / "day", logs=(tmp_path / "day" / "logs", tmp_path / "elsewhere"))
    shutil.move(tmp_path / "day", tmp_path / "deeper" / "day")
    found = read_parameters(tmp_path / "deeper" / "day" / "parameters.toml").logs
    assert found[0] == tmp_path / "deeper" / "day" / "logs"
    assert found[0].is_dir()


@pytest.mark.parametrize(
    ("pattern", "text", "words"),
    [
        (r"(inertia\]\nvalue = )[^\n]*", r"\g<1>-5.0", "inertia is -5"),
        (r"(inertia\]\nvalue = )[^\n]*", r"\g<1>0.0", "inertia is 0"),
        (r"(inertia\]\nvalue = )[^\n]*", r"\g<1>nan", "inertia is nan"),
        (r"(quadratic_drag\]\nvalue = )[^\n]*", r"\g<1>inf", "quadratic_drag is inf"),
        (r"(linear_drag\]\nvalue = )[^\n]*", r"\g<1>-1.0", "linear_drag is -1"),
        (r"(inertia\]\nvalue = )[^\n]*", r'\g<1>"much"', "much"),
        (r"(?s)matrix = \[.*?\n\]", "matrix = [[1.0]]", "damaged"),
        (r"(?s)\[covariance\].*?\n\]\n\]|\[covariance\]\nnames", "[other]\nnames", "no 'covariance'"),
        (r"standard_error = [^\n]*\n", "", "no 'standard_error'"),
        (r"(?s)logs = \[.*?\]", "logs = 5", "damaged"),
        (r"schema = [^\n]*", 'schema = "rovid-parameters/99"', "newer"),
        (r"schema = [^\n]*\n", "", "schema None"),
        (r"\Z", "]]", "is not valid TOML"),
        (r"schema = [^\n]*", 'schema = "rovid-parameters/²"', "rovid-parameters/²"),
        (r"schema = [^\n]*", f'schema = "rovid-parameters/{"9" * 5000}"', "rovid-parameters/1 was expected"),
        (
            r"(inertia\]\nvalue = )[^\n]*",
            rf"\g<1>{'9' * 400}",
            "parameters.inertia.value: is an integer of more than 64 bits",
        ),
        (r"(inertia\]\nvalue = )[^\n]*", rf"\g<1>{'9' * 5000}", "is not valid TOML"),
        (r"(inertia\]\nvalue = )[^\n]*", r"\g<1>1e300", "inertia is 1e+300; a number up to 1e+18"),
        (r"(inertia\]\nvalue = )[^\n]*", r"\g<1>1e-300", "inertia is 1e-300, which is not possible"),
        (r"(inertia\]\nvalue = )[^\n]*", r"\g<1>true", "inertia is True; a number"),
        (r"(inertia\]\nvalue = )[^\n]*", rf"\g<1>{'[' * 3000}{']' * 3000}", "nested deeper"),
        (r"samples = \d+", "samples = inf", "samples is inf; a whole number"),
        (r"samples = \d+", "samples = -1", "samples is -1; a whole number"),
        (r"standard_error = [^\n]*", "standard_error = nan", "standard_error of inertia is nan; a number"),
        (r"standard_error = [^\n]*", "standard_error = inf", "standard_error of inertia is inf; a number"),
        (r"standard_error = [^\n]*", "standard_error = -10.0", "standard_error of inertia is -10; zero or more"),
        (MATRIX, "matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]", "is not a square matrix"),
        (MATRIX, "matrix = [[1.0, 0.5, 0.0], [0.4, 1.0, 0.0], [0.0, 0.0, 1.0]]", "not symmetric"),
        (
            MATRIX,
            "matrix = [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]",
            "the covariance is not positive semidefinite",
        ),
        (
            MATRIX,
            "matrix = [[1e-9, 0.0, 0.0], [0.0, -1e-9, 0.0], [0.0, 0.0, 1.0]]",
            "the covariance is not positive semidefinite",
        ),
        (
            MATRIX,
            "matrix = [[1.0, 1.1, 0.0], [1.1, 1.0, 0.0], [0.0, 0.0, 1.0]]",
            "the covariance is not positive semidefinite",
        ),
        (
            MATRIX,
            "matrix = [[0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]]",
            "the covariance is not positive semidefinite",
        ),
        (
            MATRIX,
            "matrix = [[1.0, 0.9, 0.9], [0.9, 1.0, -0.9], [0.9, -0.9, 1.0]]",
            "the covariance is not positive semidefinite",
        ),
        (MATRIX, "matrix = [[nan, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]", "a covariance is nan"),
        (r'names = \[\n\s+"inertia"', 'names = [ "inertias"', "names of the covariance"),
        (r'names = \[\n\s+"inertia"', 'names = [ "linear_drag"', "names of the covariance"),
    ],
)
def test_a_file_edited_by_hand_is_refused_by_name(pattern: str, text: str, words: str, tmp_path: Path) -> None:
    path = written(tmp_path).path
    path.write_text(re.sub(pattern, text, path.read_text(), count=1))
    with pytest.raises(ConfigError, match=re.escape(words)) as error:
        read_parameters(path)
    assert str(path) in str(error.value)


@pytest.mark.parametrize(
    "matrix",
    [
        "[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]",  # less than the standard errors, which hold more
        "[[1e4, -7.071e4, 0.0], [-7.07e4, 5e5, 0.0], [0.0, 0.0, 1e-6]]",  # rounded by hand, wholly correlated
        "[[1e22, 0.0, 0.0], [0.0, 1e-12, 0.0], [0.0, 0.0, 1e-30]]",
    ],
)
def test_valid_covariances_are_accepted(matrix: str, tmp_path: Path) -> None:
    path = written(tmp_path).path
    path.write_text(re.sub(MATRIX, f"matrix = {matrix}", path.read_text()))
    assert len(read_parameters(path).covariance) == 6


def test_zero_drag_is_a_drag(tmp_path: Path) -> None:
    path = written(tmp_path).path
    path.write_text(re.sub(r"(linear_drag\]\nvalue = )[^\n]*", r"\g<1>0.0", path.read_text()))
    assert read_parameters(path).model().linear_drag == 0.0


@pytest.mark.parametrize(("folder", "words"), [(False, "no such parameter file"), (True, "is a folder")])
def test_a_missing_file_and_a_folder_have_different_messages(tmp_path: Path, words: str, *, folder: bool) -> None:
    with pytest.raises(ConfigError, match=words):
        read_parameters(tmp_path if folder else tmp_path / "none.toml")
