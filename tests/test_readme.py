"""The README's first block works as it stands, from a checkout."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from tests.conftest import ROOT


def first_block() -> str:
    match = re.search(r"```sh\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    assert match is not None
    return match.group(1)


def test_first_block_ends_in_a_page(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "sample_logs" / "rosub_tank", tmp_path / "sample_logs" / "rosub_tank")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-euc", first_block()],
        check=False,  # the assertion below shows what it said
        cwd=tmp_path,
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    page = tmp_path / "report" / "index.html"
    assert done.stdout.strip().endswith("report/index.html")
    assert page.stat().st_size > 100_000
    assert (tmp_path / "parameters.toml").is_file()


def test_make_demo_is_in_the_readme() -> None:
    assert "make demo" in (ROOT / "README.md").read_text()
