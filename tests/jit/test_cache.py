"""The cache of compiled code is valid exactly while the code is unchanged."""

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


# What some functions of each copy of rovid are made of, a line a copy. What serves all copies is imported once.
DIGESTS = """
    import json, sys
    for folder in sys.argv[1:]:
        for name in [name for name in sys.modules if name.partition(".")[0] == "rovid"]:
            del sys.modules[name]
        sys.path[0] = folder
        from rovid.jit.cache import content_hash
        from rovid.model.kernels import rk4
        assert rk4.__file__.startswith(folder)
        print(json.dumps({"step": content_hash(rk4.rk4_step.py_func), "bare": content_hash(rk4._simulate.py_func)}))
"""
CHANGES = [
    # An equation is part of each step with effects, as is what it calls.
    ("effects/bias_torque.py", "return p[0]", "return -p[0]", {"step"}),
    ("effects/base.py", "* abs(rate) +", "* abs(rate) -", {"step"}),
    ("model/kernels/rk4.py", "2.0 * slopes[0]", "3.0 * slopes[0]", {"step", "bare"}),
    ("effects/base.py", "REFERENCE_RATE = 0.3", "REFERENCE_RATE = 0.4", {"step"}),
    ("effects/catalogue.py", '    "coulomb_resistance",\n', "", {"step"}),
    ("jit/llvm_vector.py", '("contract",)', "()", {"step", "bare"}),
    # What people read is no part of it, nor is what bounds a search.
    ("effects/coulomb_resistance.py", 'title="', 'title="some ', set()),
    ("effects/tank_seiche.py", "low=0.005", "low=0.004", set()),
    ("model/kernels/rk4.py", '"""', '"""New: ', set()),
]


@pytest.mark.slow
def test_the_hash_changes_with_all_that_is_compiled_into_a_function(tmp_path: Path) -> None:
    for number, (changed, before, after, _) in enumerate(CHANGES):
        source = copied(tmp_path / str(number)) / "rovid" / changed
        text = source.read_text()
        assert before in text
        source.write_text(text.replace(before, after, 1))
    folders = [str(copied(tmp_path / "as it was")), *(str(tmp_path / str(number)) for number in range(len(CHANGES)))]
    # What Python runs with -c it looks for in the working folder first.
    command = [sys.executable, "-c", textwrap.dedent(DIGESTS), *folders]
    done = subprocess.run(command, cwd=folders[0], capture_output=True, text=True, check=True)
    earlier, *later = map(json.loads, done.stdout.splitlines())
    touched = [{name for name in earlier if earlier[name] != now[name]} for now in later]
    assert [(*change[:-1], found) for change, found in zip(CHANGES, touched, strict=True)] == CHANGES


COUNT = """
    import json
    import numpy as np
    from rovid.effects.base import Body
    from rovid.model.kernels import rk4
    from rovid.jit.decorators import is_cached
    was = is_cached(rk4._simulate)
    rate, _ = rk4.simulate(np.arange(3.0), np.ones(3), Body(1.0, 1.0, 1.0), 0.0)
    (missed,) = rk4._simulate.stats.cache_misses.values() or (0,)
    print(json.dumps([was, missed, rate[-1]]))
"""


def counted(folder: Path) -> tuple[bool, int, float]:
    """By the copy of rovid in ``folder``: whether a loop was compiled before, how often it is now, what it says."""
    environment = os.environ | {"PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / "numba")}
    command = [sys.executable, "-W", "error", "-c", textwrap.dedent(COUNT)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    was, missed, rate = json.loads(done.stdout)
    return was, missed, rate


@pytest.mark.slow
def test_a_loop_is_compiled_again_after_a_change_of_code_only(tmp_path: Path) -> None:
    was, missed, rate = counted(copied(tmp_path))
    assert (was, missed) == (False, 1)
    # As an upgrade installs it: new files, some with other words in them.
    source = tmp_path / "rovid" / "model" / "kernels" / "rk4.py"
    source.write_text(source.read_text().replace('"""', '"""New words.\n\n', 1))
    assert counted(tmp_path) == (True, 0, rate)
    # Another equation.
    source.write_text(source.read_text().replace("2.0 * slopes[0]", "3.0 * slopes[0]"))
    was, missed, changed = counted(tmp_path)
    assert (was, missed) == (False, 1)
    assert changed != rate


@pytest.mark.slow
def test_a_damaged_cache_entry_is_replaced(tmp_path: Path) -> None:
    *_, rate = counted(copied(tmp_path))
    for ending, compiled in ("nbi", 1), ("nbc", 1), (None, 0):
        for damaged in (tmp_path / "numba").rglob(f"rk4._simulate*.{ending}"):
            damaged.write_bytes(damaged.read_bytes()[:20])
        assert counted(tmp_path)[1:] == (compiled, rate)
