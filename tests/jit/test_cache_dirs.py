"""Cache folders of numba and matplotlib."""

from __future__ import annotations

import contextlib
import os
import shutil
import stat
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.core.test_files import AS_NOBODY, NOBODY, public_folder

pytestmark = pytest.mark.usefixtures("here")


@contextlib.contextmanager
def read_only_install() -> Iterator[tuple[Path, dict[str, str]]]:
    """A package that its user may not write, and the environment of one without a home; an empty temporary folder."""
    import filelock

    with public_folder() as folder:
        shutil.copytree(ROOT / "rovid", folder / "rovid", ignore=shutil.ignore_patterns("__pycache__"))
        temporary = folder / "tmp"
        temporary.mkdir()
        temporary.chmod(0o1777)
        path = os.pathsep.join([str(folder), str(Path(filelock.__file__).parent.parent)])
        keep = {name: value for name, value in os.environ.items() if not name.startswith(("XDG_", "NUMBA_", "MPL"))}
        yield folder, keep | {"PYTHONPATH": path, "HOME": "/nonexistent", "TMPDIR": str(temporary)}


USE = """
    import rovid.model.kernels
    import rovid.present.plots.canvas
    from rovid.effects.base import Body
    from rovid.model.kernels import simulate
    from rovid.model.kernels.rk4 import rk4_step
    import numpy as np
    from pathlib import Path
    assert rovid.model.kernels.__file__.startswith({folder!r})
    if {run}:
        simulate(np.arange(3.0), np.zeros(3), Body(1.0, 1.0, 1.0), 0.0)
    print(any(Path(str(rk4_step.stats.cache_path)).glob("rk4._simulate*.nbi")))
"""


def used(folder: Path, environment: dict[str, str], *, run: bool) -> subprocess.CompletedProcess[str]:
    code = textwrap.dedent(USE.format(folder=str(folder), run=run))
    return subprocess.run(
        [*AS_NOBODY, sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env=environment,
        cwd=folder,
    )


@NOBODY
@pytest.mark.slow
def test_without_a_home_folder_a_private_folder_holds_the_cache() -> None:
    with read_only_install() as (folder, environment):
        first = used(folder, environment, run=True)
        assert first.stdout == "True\n"
        assert first.stderr.count("Note: compiled code and fonts are kept in") == 1
        assert first.stderr.count("\n") == 1
        private = folder / "tmp" / "rovid-cache-65534"
        assert stat.S_IMODE(private.stat().st_mode) == 0o700
        assert used(folder, environment, run=False).stderr == ""


@pytest.mark.slow
@NOBODY
def test_a_folder_of_another_user_is_not_used() -> None:
    with read_only_install() as (folder, environment):
        planted = folder / "tmp" / "rovid-cache-65534"
        planted.mkdir()
        planted.chmod(0o777)
        done = used(folder, environment | {"MPLCONFIGDIR": str(folder / "tmp")}, run=False)
        assert done.stdout == "False\n"
        assert "no writable folder for compiled code" in done.stderr
        assert done.stderr.count("\n") == 1
        assert list(planted.iterdir()) == []
        assert not (folder / "None").exists()
