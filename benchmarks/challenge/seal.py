"""Draws the campaigns of a round, and seals them: the secret behind them is published as a hash, and later itself.

The secret is "SALT:SEED". Its SHA-256 stands in benchmarks/challenge/rounds.json from the beginning, the secret once
the round is closed. Each campaign's seed is made of the secret, so nobody can draw the campaigns again before.
"""

from __future__ import annotations

import hashlib
import json
import math
import tempfile
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.calibration import RUNS, SPREAD, _cause
from benchmarks.challenge.rules import CAUSES, NONE, OTHER, PARAMETERS
from tools import hard, planar
from tools.cases import all_cases
from tools.programme import campaign_for
from tools.trial_day import write_trial_day
from tools.truth import VEHICLES

HELD_OUT, ASKED = 0.25, 10  # share of the last run whose heading is held out, and instants asked for
_NOTHING, _OUTSIDE = 0.25, 0.1  # shares of calm campaigns without a cause, and with one outside the list
_RENAMED = {"trial_scale": "thrust_scale_by_trial"}
_WAVES = 0.01  # of the torque in use: waves that the description mentions
Drawn = dict[str, Any]


def digest(secret: str) -> str:
    """SHA-256 of a secret."""
    return hashlib.sha256(secret.encode()).hexdigest()


def _calm(seed: int, folder: Path) -> Drawn:
    """One axis, exact integration, one coloured disturbance; many runs of a trial day."""
    rng = np.random.default_rng(seed)
    vehicle = VEHICLES[int(rng.integers(len(VEHICLES)))]
    factor = {name: math.exp(spread * rng.normal()) for name, spread in SPREAD.items()}
    dynamics, kind = vehicle.dynamics, rng.random()
    truth = replace(
        vehicle,
        dynamics=replace(dynamics, **{name: getattr(dynamics, name) * factor[name] for name in PARAMETERS}),
        disturbance=replace(
            vehicle.disturbance, standard_deviation=vehicle.disturbance.standard_deviation * factor["disturbance"]
        ),
    )
    cause, parameters = NONE, {name: float(getattr(truth.dynamics, name)) for name in PARAMETERS}
    if kind > _NOTHING:
        outside = kind < _NOTHING + _OUTSIDE
        cases = [case for case in all_cases(truth) if case.driver]
        case = cases[int(rng.integers(len(cases)))] if outside else _cause(truth, rng)
        cause, truth = case.expected_effect or OTHER, case.of(truth)
    programme = campaign_for(truth)
    chosen = rng.permutation(len(programme))[: int(rng.integers(*RUNS, endpoint=True))]
    write_trial_day(folder, seed=int(rng.integers(2**31)), formats="csv", truth=truth,
                    campaign=[programme[place] for place in chosen.tolist()])  # fmt: skip
    return {"cause": cause, "parameters": parameters, "order": [programme[place].name for place in chosen.tolist()]}


def _hard(seed: int, folder: Path) -> Drawn:
    """Surge, sway and yaw in waves and gusts, under a pilot or an autopilot; few and short runs."""
    campaign = replace(hard.draw(seed), format="csv", clock="relative")
    hard.write_campaign(folder, campaign)
    truth = campaign.truth()
    cause = truth["hidden"]["effect"] if truth["hidden"] else NONE
    known = {"thruster_lag_s": truth["rotor_seconds"], "advance_speed_loss": truth["advance_loss"],
             "waves": truth["waves"] >= _WAVES}  # fmt: skip
    return {"cause": _RENAMED.get(cause, cause), "parameters": truth["parameters"], "known": known}


def _planar(seed: int, folder: Path) -> Drawn:
    """The coupled motion of surge, sway and yaw; causes of the coupling and currents are outside the list."""
    rng = np.random.default_rng(seed)
    family = str(rng.choice(["rov", "usv", "auv_lateral"]))
    campaign = planar.draw(int(rng.integers(2**31)), 0, None, family, log_format="csv")
    planar.write_campaign(folder, replace(campaign, clock="relative"))
    truth = planar.truth_of(campaign)
    cause = truth["hidden"] or NONE
    if cause not in {NONE, *CAUSES} or (cause == "bias_torque" and truth["form"] != "yaw"):
        cause = OTHER
    parameters = {name: truth["parameters"][f"yaw.{name}"] for name in PARAMETERS}
    return {"cause": cause, "parameters": parameters, "known": {"waves": bool(truth["waves"])}}


SIMULATORS: dict[str, Callable[[int, Path], Drawn]] = {"calm": _calm, "hard": _hard, "planar": _planar}


def draw_round(secret: str, count: int, folder: Path) -> None:
    """Write ``count`` campaigns of each simulator into a folder, and truth.json; campaigns that are there stay."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "truth.json"
    truths = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    for simulator in SIMULATORS:
        for number in range(count):
            name = f"{simulator}_{number:02d}"
            if name not in truths:
                truths[name] = _draw(simulator, int(digest(f"{secret}/{name}")[:8], 16), folder / name)
                path.write_text(json.dumps(truths, indent=1) + "\n", encoding="utf-8")


def _draw(simulator: str, seed: int, folder: Path) -> Drawn:
    with tempfile.TemporaryDirectory() as room:
        raw = Path(room) / "raw"
        drawn = SIMULATORS[simulator](seed, raw)
        turns = convert(raw, folder, drawn.get("known", {}), drawn.pop("order", None))
    return {"simulator": simulator, **drawn, "turns": turns}


def convert(raw: Path, folder: Path, known: dict[str, Any], order: list[str] | None) -> list[float]:
    """Rewrite a simulator's folder in the format of the challenge, without rovid.toml; return the held-out turns."""
    told = tomllib.loads((raw / "rovid.toml").read_text(encoding="utf-8"))
    folder.mkdir(parents=True, exist_ok=True)
    thrusters = []
    for one in told["thrusters"]:
        curve = pd.read_csv(raw / one["curve"])
        levers = {"yaw_arm_m": one.get("yaw_arm"), **{share: one[share] for share in ("surge", "sway") if share in one}}
        if "position" in one:
            (x, y), angle = one["position"], math.radians(one["direction"])
            levers = {"yaw_arm_m": x * math.sin(angle) - y * math.cos(angle),
                      "surge": math.cos(angle), "sway": math.sin(angle)}  # fmt: skip
        thrusters.append({"name": one["name"], **levers, "curve": curve.iloc[:, :2].to_numpy().tolist()})
    columns = {told["signals"]["time"]["csv"]: "time_s"}
    columns |= {one["command"]["csv"]: one["name"] for one in told["thrusters"]}
    units = {"deg": "_deg", "deg/s": "_deg_s"}
    for signal, source in told["signals"].items():
        columns.setdefault(source["csv"], signal + units.get(source.get("unit"), ""))
    stems = [raw / f"{name}.csv" for name in order] if order else sorted(raw.glob("run_*.csv"))
    for number, path in enumerate(stems, start=1):
        table = pd.read_csv(path)[list(columns)].rename(columns=columns)
        table["time_s"] -= table["time_s"].iloc[0]
        if number == len(stems):
            held, turns = _hold_out(table, [one["name"] for one in thrusters])
        table.to_csv(folder / f"run_{number:02d}.csv", index=False)
    vehicle = {key: value for key, value in told["vehicle"].items() if key != "name"}
    document = {"vehicle": vehicle, "thrusters": thrusters, "known": known, "held_out": held}
    (folder / "vehicle.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    return turns


def _hold_out(table: pd.DataFrame, commands: list[str]) -> tuple[dict[str, Any], list[float]]:
    """Empty all but time and commands in the last part of the last run; what is asked for, and the truth of it."""
    read = table.dropna(subset=["heading_deg"])
    time, heading = read["time_s"].to_numpy(), np.degrees(np.unwrap(np.radians(read["heading_deg"].to_numpy())))
    first = int((1.0 - HELD_OUT) * time.size)
    places = np.unique(np.linspace(first, time.size - 1, ASKED + 1).astype(int))[1:]
    turns = (heading[places] - heading[first]).tolist()
    hidden = table["time_s"] > time[first]
    table.loc[hidden, [name for name in table.columns if name not in {"time_s", *commands}]] = np.nan
    return {"after_s": float(time[first]), "times_s": time[places].tolist()}, turns
