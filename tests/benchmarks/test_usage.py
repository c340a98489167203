"""What a command takes is its own, and one that fails is said."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from benchmarks.usage import measured

MEGABYTES = 200


def test_what_a_command_takes(tmp_path: Path) -> None:
    ballast = bytearray(MEGABYTES << 20)  # of ours, which is not to count
    ballast[::4096] = b"x" * len(ballast[::4096])
    idle = measured([sys.executable, "-I", "-c", "print('done', end='')"], tmp_path)
    assert idle.out == "done"
    assert idle.megabytes < MEGABYTES
    work = f"held = b'x' * ({MEGABYTES} << 20); sum(range(3_000_000))"
    busy = measured([sys.executable, "-I", "-c", work], tmp_path)
    assert busy.megabytes > MEGABYTES
    assert 0.0 < idle.processor < busy.processor


def test_a_command_that_fails_is_said(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="no such"):
        measured([sys.executable, "-c", "raise SystemExit('no such')"], tmp_path)
