"""The background compiler: its work, its failures, its end."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

from rovid.model.kernels.warmup import BackgroundCompiler
from tests.conftest import ROOT

# s; more than a loaded machine takes to start Python.
PATIENCE = 60.0


SLOW = """
import os, time
from rovid.model.kernels.warmup import report_done
def parts():
    print("no part of it")
    yield "one"
    while not os.path.exists({go!r}):
        time.sleep(0.01)
    yield "two"
report_done(parts())
"""


def waited(second: BackgroundCompiler, part: str) -> float:
    """How long, in s."""
    start = time.perf_counter()
    second.wait_for(part, PATIENCE)
    return time.perf_counter() - start


def ended(pid: int) -> bool:
    """Whether it is gone, soon."""
    for _ in range(int(10.0 * PATIENCE)):
        found = subprocess.run(["ps", "-o", "stat=", "-p", str(pid)], check=False, capture_output=True, text=True)
        # Z: it has ended, and nobody has asked how.
        if found.stdout.strip()[:1] in ("", "Z"):
            return True
        time.sleep(0.1)
    return False


def test_each_part_is_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # It imports what this process would, wherever it stands.
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rovid.py").write_text("raise SystemExit\n")
    go = tmp_path / "go"
    second = BackgroundCompiler(f"exec({SLOW.format(go=str(go))!r})", ("one", "two"))
    try:
        assert waited(second, "one") < PATIENCE
        start = time.perf_counter()
        second.wait_for("two", 0.2)
        assert time.perf_counter() - start > 0.15
        go.touch()
        assert waited(second, "two") < PATIENCE
    finally:
        second.stop()


@pytest.mark.parametrize("code", ["raise SystemExit(3)", "import os; os.abort()", "print('nonsense')"])
def test_a_failed_compiler_is_not_waited_for(code: str) -> None:
    second = BackgroundCompiler(code, ("one",))
    assert waited(second, "one") < PATIENCE
    second.stop()
    assert ended(second.pid)


def test_a_stopped_compiler_is_not_waited_for() -> None:
    second = BackgroundCompiler("import time; time.sleep(1000)", ("one",))
    second.stop()
    assert waited(second, "one") < PATIENCE
    assert ended(second.pid)


FIRST = """
    import os, sys, time
    from rovid.model.kernels.warmup import BackgroundCompiler
    code = "import time; from rovid.model.kernels import warmup as c; c.report_done(map(time.sleep, [1000, 1000]))"
    second = BackgroundCompiler(code, ("one",))
    print(second.pid, flush=True)
    {then}
"""


@pytest.mark.parametrize("then", ["pass", "raise SystemExit(2)", "1 / 0", "os.abort()", "os._exit(1)"])
def test_the_second_process_ends_with_the_first(then: str) -> None:
    code = textwrap.dedent(FIRST.format(then=then))
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", code], check=False, env=environment, capture_output=True, text=True)
    assert ended(int(done.stdout))
