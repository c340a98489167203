"""``rovid effect``: the files of a new effect, and refusals."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import Rovid


def test_a_new_effect_replaces_no_file_and_no_effect(rovid: Rovid) -> None:
    assert rovid("effect", "new", "spring_line", "--json").document["files"] == [
        "spring_line.py",
        "test_spring_line.py",
    ]
    assert 'id="spring_line"' in Path("spring_line.py").read_text()
    for name, words in (
        ("spring_line", "already exists"),
        ("thruster_lag", "is an effect already"),
        ("A b", "no name"),
    ):
        refused = rovid("effect", "new", name)
        assert (refused.code, words in refused.err) == (2, True)
    assert rovid("effect", "try", "spring_line.py").code == 2


def test_a_command_has_no_plug_in_of_the_command_before(rovid: Rovid) -> None:
    """In a process of its own a command tries the catalogue alone, and so do the commands of these tests."""
    assert rovid("effect", "new", "spring_line").code == 0
    for _ in range(2):
        refused = rovid("fit", "nowhere", "--effect", "spring_line")
        assert "there is no effect 'spring_line'" in refused.err
        assert rovid("fit", "nowhere", "--effect", "spring_line", "--effects-from", "spring_line.py").code == 2


@pytest.mark.slow
def test_the_test_of_a_new_effect_passes_as_written(rovid: Rovid) -> None:
    assert rovid("effect", "new", "spring_line").code == 0
    command = [sys.executable, "-m", "pytest", "-q", "test_spring_line.py"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
