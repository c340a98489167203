"""Warm-up: the first use gives the results of later ones, with or without a second process."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

from rovid.model.kernels import warmup
from tests.conftest import ROOT

USE = """
import json, sys
from dataclasses import replace
import numpy as np
from rovid.effects import effect_named
from rovid.model import kernels
from rovid.model.torque_input import TorqueInput
from rovid.model.kernels import warmup
from tests.filters import Log, filter_one
from tests.synthetic import ROSUB

begun, second = [], warmup.BackgroundCompiler
warmup.BackgroundCompiler = lambda *told: begun.append(second(*told)) or begun[-1]
{before}
kernels.start_compiling()
time = 0.1 * np.arange(40)
log, drive = Log(time=time, angle=0.01 * np.sin(time)), TorqueInput.held(np.full(40, 80.0))
found = []
for key, values in {effects}.items():
    model = replace(ROSUB, effects=(effect_named(key),) if key else (), effect_values=values)
    kernel = kernels.ekf5_innovations if key == "wave_torque" else kernels.ekf3_innovations
    found += filter_one(kernel, log, drive, model, (15.0, 4.0, 1e-3, 1e-2))
here = np.array([0, 2]), np.ones(1), np.ones((2, 3)), np.zeros((2, 3)), np.ones(1)
found += kernels.effects_along(*here, ROSUB.body, ROSUB.terms)
others = (loop for name, loop in warmup._SLOW_LOOPS.items() if name != warmup._OWN)
missed = sum(sum(loop.stats.cache_misses.values()) for loop in others)
print(json.dumps([np.nan_to_num(np.concatenate([np.ravel(one) for one in found])).tolist(), missed, len(begun)]))
"""
EVERY = {"": (), "oscillatory_drag": (0.5, 0.6), "wave_torque": (20.0, 0.8, 0.1)}
SEVERAL, ONE = "warmup.core_count = lambda: 2", "warmup.core_count = lambda: 1"


def told(cache: Path, before: str, effects: Mapping[str, object]) -> tuple[list[float], int, int]:
    """Numbers that are the same whoever compiles, how many loops were compiled here, and whether a second was begun."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", USE.format(before=before, effects=effects)],
        env=os.environ | {"PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(cache)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stderr == ""
    numbers, missed, begun = json.loads(done.stdout)
    return numbers, missed, begun


@pytest.mark.slow
def test_a_second_process_compiles_at_first_use(tmp_path: Path) -> None:
    numbers, missed, begun = told(tmp_path, SEVERAL, EVERY)
    assert (missed, begun) == (0, 1)
    assert told(tmp_path, SEVERAL, EVERY) == (numbers, 0, 0)


@pytest.mark.parametrize(
    ("fate", "begun"),
    [
        ("sys.executable = '/nonexistent'", 0),
        ("sys.executable = 'false'", 1),
        ("import threading; threading.Timer(0.5, lambda: begun[0].stop()).start()", 1),
    ],
)
@pytest.mark.slow
def test_a_failed_background_process_does_no_harm(tmp_path: Path, fate: str, begun: int) -> None:
    numbers, missed, found = told(tmp_path, f"{SEVERAL}; {fate}", {})
    assert (missed, found) == (1, begun)
    assert told(tmp_path, ONE, {}) == (numbers, 0, 0)


@pytest.mark.parametrize(
    ("name", "value"),
    [("can_cache", lambda: False), ("is_compiled", lambda: True), ("core_count", lambda: 1), ("sys.executable", "")],
)
def test_no_background_process_without_need(name: str, value: object, monkeypatch: pytest.MonkeyPatch) -> None:
    begun: list[object] = []
    monkeypatch.setattr(warmup, "BackgroundCompiler", lambda *told: begun.append(told))
    needed = {"can_cache": lambda: True, "is_compiled": lambda: False, "core_count": lambda: 2}
    for one, found in (needed | {name: value}).items():
        monkeypatch.setattr(sys if "." in one else warmup, one.rpartition(".")[2], found)
    warmup.start_compiling()
    assert begun == []
