"""Peers are given the motion that rovid knows, and recover it where nothing disturbs."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.peers import __main__ as peers
from benchmarks.peers import log
from benchmarks.peers.motion import simulated
from rovid.model.kernels import simulate
from tests.conftest import ROOT
from tests.synthetic import ROSUB, clock

TIME = clock(120.0)
TORQUE = np.where(TIME % 40.0 < 25.0, 120.0, -200.0)
TRUE = ROSUB.values


def heading() -> log.Floats:
    return 1.0 + simulate(TIME, TORQUE, ROSUB.body, 0.0)[1]


def test_the_motion_of_the_peers_is_that_of_rovid() -> None:
    # As precise as both need to be beside the noise: their steps differ.
    np.testing.assert_allclose(simulated(TIME, TORQUE, 1.0, *TRUE), heading(), rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("peer", peers.PEERS)
def test_a_peer_that_is_installed_recovers_the_truth(peer: str, tmp_path: Path) -> None:
    if not peers.is_installed(peer):
        pytest.skip(f"{peer} is not installed")
    log.write(str(tmp_path / "log.csv"), TIME, TORQUE, heading())
    command = [sys.executable, "-m", f"benchmarks.peers.with_{peer}", str(tmp_path / "log.csv")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    assert list(found) == list(log.NAMES)
    # Where they stop searching.
    np.testing.assert_allclose(list(found.values()), TRUE, rtol=2e-3)


def test_a_peer_that_is_not_there_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(peers.PEERS, "other", ("no_such_module", "fit"))
    assert not peers.is_installed("other")
    monkeypatch.setitem(peers.PEERS, "other", ("json", "fit"))
    assert not peers.is_installed("other")
