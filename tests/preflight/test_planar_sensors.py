"""Wrong signs, units and axes in rovid.toml of the coupled model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from rovid.planar.dataset import PlanarData, planar_data
from rovid.planar.model import SENSORS
from rovid.preflight.planar_sensors import wrong_entries
from rovid.trial.trial import Campaign
from tests.planar.vehicles import Truth, box_rov, campaign

TRACK = {"heading": (0.005, 0.05), "north": (0.02, 0.2), "east": (0.02, 0.2)}


def texts(data: PlanarData) -> list[str]:
    return [one.text for one in wrong_entries(data)]


def with_signs(data: PlanarData, *names: str) -> PlanarData:
    numbers = list(map(SENSORS.index, names))
    runs = [
        replace(run, event_value=np.where(np.isin(run.event_sensor, numbers), -1.0, 1.0) * run.event_value)
        for run in data.runs
    ]
    return replace(data, runs=tuple(runs))


def exchanged(data: PlanarData) -> PlanarData:
    order = np.array([0, 1, 2, 3, 5, 4])
    return replace(data, runs=tuple(replace(run, event_sensor=order[run.event_sensor]) for run in data.runs))


def reversed_thrusters(data: PlanarData, names: Sequence[str]) -> PlanarData:
    def turned(name: str) -> int:
        return -1 if name in names else 1

    thrusters = tuple(
        replace(
            one,
            arm=turned(one.name) * one.arm,
            surge_share=turned(one.name) * one.surge_share,
            sway_share=turned(one.name) * one.sway_share,
        )
        for one in data.vehicle.thrusters
    )
    trials = tuple(run.trial for run in data.runs)
    return planar_data(Campaign(trials=trials, sources=()), replace(data.vehicle, thrusters=thrusters))


@pytest.fixture(scope="module")
def rov() -> PlanarData:
    return campaign(box_rov(3), runs=2, levels=6, hold=4.0, seed=2)


@pytest.fixture(scope="module")
def tracked() -> PlanarData:
    return campaign(box_rov(3, noise=TRACK), runs=2, levels=6, hold=4.0, seed=2)


def test_sound_logs_get_no_correction(rov: PlanarData, tracked: PlanarData) -> None:
    assert texts(rov) == texts(tracked) == []


def test_the_sign_of_a_speed_is_named(rov: PlanarData) -> None:
    (text,) = texts(with_signs(rov, "sway_velocity"))
    assert text.startswith("Change the sign of sway_velocity in rovid.toml")


def test_a_thruster_that_pushes_the_other_way_is_named(rov: PlanarData) -> None:
    (text,) = texts(reversed_thrusters(rov, ["t2"]))
    assert text.startswith("Change the sign of the thrust of t2,")


def test_exchanged_axes_and_mirror_images_are_named(tracked: PlanarData) -> None:
    assert texts(exchanged(tracked))[0].startswith("Exchange north and east in rovid.toml")
    assert texts(with_signs(tracked, "east"))[0].startswith("Change the sign of east in rovid.toml")


def test_a_track_is_compared_with_the_velocity_log() -> None:
    noise = TRACK | {"surge_velocity": (0.01, 0.2), "sway_velocity": (0.01, 0.2)}
    data = campaign(box_rov(3, noise=noise), runs=2, levels=30, hold=4.0, seed=2)
    assert texts(data) == []
    (text,) = texts(exchanged(data))
    assert text.startswith("Exchange north and east in [signals]")


@pytest.mark.parametrize(("factor", "words"), [(180.0 / np.pi, "Correct the unit"), (np.pi / 180.0, "Check the unit")])
def test_the_unit_of_a_rudder_is_named(factor: float, words: str) -> None:
    truth = with_rudder()
    data = campaign(truth, runs=1, levels=4, hold=4.0, seed=2)
    trials = [replace(run.trial, commands=run.trial.commands * np.array([1.0, factor])) for run in data.runs]
    wrong = planar_data(Campaign(trials=tuple(trials), sources=()), data.vehicle)
    assert texts(wrong)[0].startswith(f"{words} of the angle of rudder")


def with_rudder() -> Truth:
    noise = {"heading": (0.005, 0.05), "surge_velocity": (0.01, 0.2), "sway_velocity": (0.01, 0.2)}
    base = (30.0, 50.0, 5.0, 0.5, 1.0, 5.0, 1.0, 5.0, 40.0, 3.0)
    return Truth(base=base, levers=((10.0, 0.0, 0.0),), rudder=(-0.6, 20.0), noise=noise)
