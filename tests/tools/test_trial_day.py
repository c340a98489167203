"""A day's programme and its files."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from mcap.reader import make_reader

from tests.tools.motions import quiet, strong
from tools.channels import EXTRA, column
from tools.hidden import OUTSIDE
from tools.programme import Hold, Run, Sine, campaign_for
from tools.trial_day import record, write_trial_day
from tools.truth import SMALL, VEHICLES, Instruments, Truth


@pytest.mark.parametrize("vehicle", VEHICLES, ids=lambda vehicle: vehicle.command_unit)
def test_programme_suits_the_vehicle(vehicle: Truth) -> None:
    runs = campaign_for(vehicle)
    assert len({run.name for run in runs}) == len(runs) == 18
    largest = max(
        abs(level)
        for run in runs
        for piece in run.pieces
        for level in ([piece.volts] if isinstance(piece, Hold) else [piece.positive, piece.negative])
    )
    curve = vehicle.thrusters[0].curve
    assert vehicle.middle < largest < curve.limit
    (hold,) = (run for run in runs if run.name == "hold_01")
    assert isinstance(hold.pieces[0], Hold)
    assert hold.pieces[0].volts == pytest.approx(vehicle.middle)
    # Ten time constants and more, so that a hold is steady at its end.
    assert hold.pieces[0].duration > 10.0 * vehicle.time_constant


SHORT = (
    Run(name="hold", pieces=(Hold(1.0, 6.0),)),
    Run(name="sine", pieces=(Sine(1.0, 1.2, 4.0, 2),), format="json", command_rate=10.0),
    Run(name="aft", pieces=(Hold(1.0, 6.0),), format="ros2", only="aft", command_rate=None),
)


@pytest.mark.parametrize("vehicle", VEHICLES, ids=lambda vehicle: vehicle.command_unit)
def test_files_decode_and_the_configuration_finds_everything_in_them(vehicle: Truth, tmp_path: Path) -> None:
    def scaled(piece: Hold | Sine) -> Hold | Sine:
        if isinstance(piece, Hold):
            return Hold(piece.volts * vehicle.middle, piece.duration)
        return Sine(piece.positive * vehicle.middle, piece.negative * vehicle.middle, piece.period, piece.cycles)

    campaign = [replace(run, pieces=tuple(scaled(piece) for piece in run.pieces)) for run in SHORT]
    truth = strong(vehicle, OUTSIDE, "depth_drag").of(strong(vehicle, "thruster_lag", "quadratic").of(vehicle))
    write_trial_day(tmp_path, seed=3, truth=truth, campaign=campaign)
    configuration = tomllib.loads((tmp_path / "rovid.toml").read_text())
    signals = [*configuration["signals"].values(), *(t["command"] for t in configuration["thrusters"])]
    assert set(EXTRA) <= set(configuration["signals"])
    table = pd.read_csv(tmp_path / "hold.csv")
    assert {signal["csv"] for signal in signals} == set(table.columns)
    for name in ("sine", "aft"):
        with (tmp_path / f"{name}.mcap").open("rb") as stream:
            topics = {channel.topic for _, channel, _ in make_reader(stream).iter_messages()}
        assert {signal["mcap"].removesuffix(".data") for signal in signals if "mcap" in signal} <= topics
    neutral = vehicle.thrusters[0].curve.neutral
    fore = table[configuration["thrusters"][0]["command"]["csv"]]
    assert fore.iloc[0] == neutral
    assert fore.iloc[-2] == pytest.approx(neutral + vehicle.middle, rel=0.01)
    curve = pd.read_csv(tmp_path / configuration["thrusters"][0]["curve"])
    exact = vehicle.thrusters[0].curve.thrust(curve["command"].to_numpy())
    np.testing.assert_allclose(curve["thrust_N"], exact, atol=1e-4)
    assert table[column("depth")].between(1.0, 7.0).all()


def test_same_seed_same_files_with_something_hidden(tmp_path: Path) -> None:
    truth = strong(SMALL, "wave_torque", "narrow_band").of(SMALL)
    run = campaign_for(SMALL)[:1]
    for name in "ab":
        write_trial_day(tmp_path / name, seed=8, truth=truth, campaign=run, formats="csv")
    assert (tmp_path / "a" / "hold_01.csv").read_bytes() == (tmp_path / "b" / "hold_01.csv").read_bytes()


def test_instruments_count_commands_from_neutral() -> None:
    instruments = Instruments(supply=16.0, supply_drop=0.002, supply_noise=0.0, command_span=4096.0)
    truth = replace(quiet(SMALL), instruments=instruments)
    supply = record(Run(name="hold", pieces=(Hold(100.0, 2.0),)), truth, "csv", 1, 0).supply
    assert supply[0] == 16.0
    assert supply[-2] == pytest.approx(16.0 - 2 * 100.0 * 0.002)
