"""Detection of feedback, and its false alarm rate in open loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.feedback import seen, seen_in, trial_of
from rovid.preflight.advice import advise
from rovid.preflight.feedback_detection import SIGNIFICANCE_LEVEL, detect_feedback
from rovid.readers import read_campaign
from rovid.trial.axis import AXES
from rovid.trial.config import find_config, load_config
from rovid.trial.vehicle import Thruster, Vehicle
from tests import synthetic
from tests.conftest import SAMPLES, slow
from tools.hard import draw
from tools.steering import OPEN, steered

LOGGED = Vehicle(name="test", thrusters=(Thruster(name="torque", arm=1.0, curve=None),))
EACH = 10


@pytest.mark.slow
def test_open_loop_is_rarely_called_feedback() -> None:
    # 4 of 2600 such runs with other seeds; of 130 more than two would come up once in a thousand times.
    assert sum(seen(steered(kind, seed)) for kind in OPEN for seed in range(EACH)) <= 2


@pytest.mark.parametrize(
    ("kind", "share"),
    # Of 100 runs with other seeds 0.44, 0.3, 0.38, 0.39 and 0.46: fewer than these of 20 come up once in 100 times.
    [
        ("heading hold", 0.2),
        slow("autopilot", 0.1),
        slow("slow autopilot", 0.15),
        ("zigzag by heading", 0.15),
        ("stick", 0.2),
    ],
)
def test_feedback_is_detected(kind: str, share: float) -> None:
    assert np.mean([seen(steered(kind, seed)) for seed in range(2 * EACH)]) >= share


def test_pseudo_random_runs_are_no_feedback() -> None:
    runs = [steered(kind, seed) for seed in range(6) for kind in ("random binary", "clocked binary")]
    trials = [replace(trial_of(run), name=f"run_{number}") for number, run in enumerate(runs)]
    assert detect_feedback(trials, LOGGED) == []


@pytest.mark.parametrize(("campaigns", "runs"), [(12, 9), (40, 40)])
@pytest.mark.slow
def test_hard_campaigns_are_no_feedback(campaigns: int, runs: int) -> None:
    found: dict[str, list[bool]] = {}
    for seed in range(campaigns):
        for kind, named in seen_in(draw(seed)):
            found.setdefault(kind, []).append(named)
    blind = [named for kind in ("prbs", "holds", "steps", "sines") for named in found[kind]]
    # 1 of 627 runs with other seeds.
    assert len(blind) > runs
    assert sum(blind) <= 2
    assert np.mean(found["autopilot"]) > 0.4
    assert np.mean(found["zigzag"]) > 0.6


def test_a_real_dive_has_feedback() -> None:
    for folder in ("bluerov2_pier59", "bluerov2_dataflash"):
        config = load_config(find_config([SAMPLES / folder]))
        (found,) = detect_feedback(read_campaign([SAMPLES / folder], config).trials, config.vehicle)
        assert found.seen_in == "flow"
        assert found.chance < 1e-4


@pytest.mark.parametrize(("day", "axis"), [("rosub_tank", "yaw"), ("surge_tank", "surge"), ("pitch_tank", "pitch")])
def test_the_sample_campaigns_are_open_loop(day: str, axis: str) -> None:
    config = load_config(find_config([SAMPLES / day]), AXES[axis])
    assert detect_feedback(read_campaign([SAMPLES / day], config).trials, config.vehicle) == []


def test_a_zigzag_by_heading_is_feedback_at_its_reversals() -> None:
    found = []
    for seed in range(2 * EACH):
        trial = trial_of(steered("zigzag by heading", seed))
        found += [(trial, one) for one in detect_feedback([trial], LOGGED) if one.seen_in == "reversals"]
    trial, sure = next((trial, one) for trial, one in found if one.chance < SIGNIFICANCE_LEVEL)
    assert 0.0 < sure.scatter < sure.by_duration
    (told,) = [one for one in advise([trial], LOGGED, [sure]) if one.kind == "feedback"]
    assert "reversed at a heading, as in a zigzag test (within " in told.text
    trial, open_ = next((trial, one) for trial, one in found if one.chance >= SIGNIFICANCE_LEVEL)
    (aside,) = [one for one in advise([trial], LOGGED, [open_]) if one.kind == "reversals"]
    assert aside.weight == "aside"
    assert "There are too few reversals to decide." in aside.text


def test_logs_are_combined() -> None:
    """A run too short by itself is reported if similar runs agree."""
    trials = [replace(trial_of(steered("slow autopilot", seed)), name=f"run_{seed}") for seed in range(2 * EACH)]
    alone = [trial.name for trial in trials if detect_feedback([trial], LOGGED)]
    together = [one.name for one in detect_feedback(trials, LOGGED)]
    assert set(alone) < set(together)


def test_unsuitable_logs_are_not_tested() -> None:
    time = synthetic.clock(60.0)
    held = synthetic.trial(time, np.full(len(time), 3.0), np.zeros(len(time)))
    unknown = synthetic.trial(time, np.where(time < 1.0, np.nan, np.sin(time)), np.sin(time))
    short = synthetic.trial(time[:20], np.sin(time[:20]), np.sin(time[:20]))
    still = synthetic.trial(time, np.sign(np.sin(time)), np.zeros(len(time)))
    assert detect_feedback([held, unknown, short, still], LOGGED) == []


def test_commands_further_apart_than_the_readings_are_no_stream() -> None:
    time = synthetic.clock(40.0)
    torque = np.where(time > 2.0, 1.0, 0.0) + np.where(time > 37.0, 1.5, 0.0)
    heading = np.where(time < 20.0, 0.01 * time, np.nan)
    assert detect_feedback([synthetic.trial(time, torque, heading)], LOGGED) == []
