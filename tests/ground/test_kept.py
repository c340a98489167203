"""What is compiled is kept until what it is made of changes, and no longer."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from tests.conftest import ROOT

pytestmark = pytest.mark.usefixtures("here")


def copied(folder: Path) -> Path:
    """A copy of rovid in ``folder``, which it returns."""
    shutil.copytree(ROOT / "rovid", folder / "rovid", ignore=shutil.ignore_patterns("__pycache__"))
    return folder


@pytest.fixture(scope="module")
def earlier(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Digests before anything changed."""
    return digests(copied(tmp_path_factory.mktemp("earlier")))


def digests(folder: Path) -> dict[str, str]:
    """Of some functions of the copy of rovid in ``folder``: what they are made of."""
    code = """
        import json
        import rovid.model.kernels
        from rovid.ground.kept import made_of
        from rovid.model.kernels import free_run, step
        print(json.dumps({"step": made_of(step.step.py_func), "bare": made_of(free_run._simulate.py_func)}))
    """
    environment = os.environ | {"PYTHONPATH": str(folder)}
    command = [sys.executable, "-c", textwrap.dedent(code)]
    # What Python runs with -c it looks for in the working folder first.
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True)
    return dict(json.loads(done.stdout))


@pytest.mark.parametrize(
    ("changed", "before", "after", "touched"),
    [
        # An equation is part of each step with effects, as is what it calls.
        ("effects/bias_torque.py", "return p[0]", "return -p[0]", {"step"}),
        ("effects/instant.py", "* abs(rate) +", "* abs(rate) -", {"step"}),
        ("model/kernels/step.py", "2.0 * brake[0]", "3.0 * brake[0]", {"step", "bare"}),
        ("effects/base.py", "REFERENCE_RATE = 0.3", "REFERENCE_RATE = 0.4", {"step"}),
        ("effects/__init__.py", '    "coulomb_resistance",\n', "", {"step"}),
        ("ground/lanes.py", '("contract",)', "()", {"step", "bare"}),
        # What people read is no part of it, nor is what bounds a search.
        ("effects/coulomb_resistance.py", 'title="', 'title="some ', set()),
        ("effects/tank_seiche.py", "low=0.005", "low=0.004", set()),
        ("model/kernels/step.py", '"""', '"""New: ', set()),
    ],
)
def test_what_is_compiled_is_held_against_what_it_is_made_of(
    tmp_path: Path, earlier: dict[str, str], changed: str, before: str, after: str, touched: set[str]
) -> None:
    source = copied(tmp_path) / "rovid" / changed
    text = source.read_text()
    assert before in text
    source.write_text(text.replace(before, after, 1))
    later = digests(tmp_path)
    assert {name for name in earlier if earlier[name] != later[name]} == touched


COUNT = """
    import numpy as np
    from rovid.effects.base import Body
    from rovid.model.kernels import free_run
    from rovid.ground.compiled import is_kept
    was = is_kept(free_run._simulate)
    rate, _ = free_run.simulate(np.arange(3.0), np.ones(3), Body(1.0, 1.0, 1.0), 0.0)
    (missed,) = free_run._simulate.stats.cache_misses.values() or (0,)
    print(was, missed, rate[-1])
"""


def test_it_is_compiled_again_when_that_changes_and_only_then(tmp_path: Path) -> None:
    copied(tmp_path)
    environment = os.environ | {"PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "numba")}

    def counted() -> list[str]:
        command = [sys.executable, "-W", "error", "-c", textwrap.dedent(COUNT)]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        assert done.stderr == ""
        return done.stdout.split()

    first = counted()
    assert first[:2] == ["False", "1"]
    kept = ["True", "0", first[2]]
    assert counted() == kept
    # As an upgrade installs it: new files, some with other words in them.
    source = tmp_path / "rovid" / "model" / "kernels" / "free_run.py"
    text = source.read_text()
    source.write_text(text.replace('"""', '"""New words.\n\n', 1))
    assert counted() == kept
    # Another equation.
    step = source.with_name("step.py")
    step.write_text(step.read_text().replace("2.0 * brake[0]", "3.0 * brake[0]"))
    changed = counted()
    assert changed[:2] == ["False", "1"]
    # Whatever else is in the files it is compiled, and kept anew.
    for ending, missed in ("nbi", "1"), ("nbc", "1"), (None, "0"):
        for damaged in (tmp_path / "numba").rglob(f"free_run._simulate*.{ending}"):
            damaged.write_bytes(damaged.read_bytes()[:20])
        assert counted()[1:] == [missed, changed[2]]
