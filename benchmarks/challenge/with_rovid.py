"""rovid: its diagnosis along yaw, or of surge, sway and yaw together, asked through its Python interface."""

from __future__ import annotations

import csv
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import rovid
from benchmarks.challenge.rules import CAUSES, NONE, OTHER, PARAMETERS, Answer, Campaign, Floats, forecast, spread

_UNITS = {"heading_deg": "deg", "yaw_rate_deg_s": "deg/s", "roll_deg": "deg", "pitch_deg": "deg"}
_BUDGET = 3600.0  # s; the default of 60 s ends a search early on a busy machine
_SURE = 0.97  # upper limit of a confidence
_NOMINAL_ERRORS = 3.0  # standard errors; a lag or loss this close to the described value is no cause
# Prior probability of a cause outside the list, with and without an unexplained torque.
_UNEXPLAINED, _EXPLAINED = 0.5, 0.03


def answer(campaign: Campaign) -> Answer:
    """rovid's answer for one axis; RovidError if rovid refuses the campaign."""
    return _answer(campaign, None)


def answer_planar(campaign: Campaign) -> Answer:
    """Answer of the coupled model; RovidError if rovid refuses the campaign."""
    return _answer(campaign, "planar")


def _answer(campaign: Campaign, axes: str | None) -> Answer:
    with tempfile.TemporaryDirectory() as room:
        known, whole = Path(room) / "known", Path(room) / "whole"
        _write(campaign, known, filled=False)
        _write(campaign, whole, filled=True)
        said = rovid.open(known, axes=axes).diagnose(force=True, budget=_BUDGET)
        if said.estimate is None:
            raise rovid.RovidError("no model.", where=campaign.name)
        simulated = []
        headings = _headings(said, rovid.open(whole, axes=axes))
        for run in campaign.runs:
            time, heading = headings.get(run.name, (run.time[:1], np.zeros(1)))  # none if too short for rovid
            simulated.append(np.asarray(np.interp(run.time, time, heading)))
    causes = spread(odds_of(said.document, campaign.description["known"]))
    sizes = {name: _quantiles(said.estimate, f"yaw.{name}" if axes else name) for name in PARAMETERS}
    return {"causes": causes, "parameters": sizes, "heading_deg": forecast(campaign, simulated)}


def _headings(said: Any, study: rovid.Study) -> dict[str, tuple[Floats, Floats]]:
    """Run -> time in s and heading in rad of its free simulation."""
    if study.coupled is not None:
        runs = study.coupled.simulate(study.coupled.model(said.stored))
        return {Path(one.run.trial.name).stem: (one.motion.time, one.motion.heading) for one in runs}
    logs, model = study.logs, said.stored.model()
    trials = [run.trial for run in logs.runs.items] if logs.runs else []
    return {
        Path(one.name).stem: (one.time, model.simulate(one, model.torque_input(logs.vehicle, one))[1]) for one in trials
    }


def odds_of(document: dict[str, Any], known: dict[str, Any]) -> dict[str, float]:
    """Odds of the one cause, from the confidence of each finding and suspect; those that cannot be told apart share."""
    odds = {NONE: 1.0, OTHER: _UNEXPLAINED if document.get("unexplained") else _EXPLAINED}
    for one in [*document["findings"], *document["suspects"]]:
        if _is_described(one, known):
            continue
        sure = min(one["confidence"], _SURE)
        rivals = [r if isinstance(r, str) else r["effect"] for r in one["cannot_be_told_from"]]
        within = [name if name in CAUSES else OTHER for name in (one["effect"], *rivals)]
        names = list(dict.fromkeys(within))
        for place, name in enumerate(names):
            # The first of a class gets half of it.
            share = (0.5 if place == 0 else 0.5 / (len(names) - 1)) if len(names) > 1 else 1.0
            odds[name] = max(odds.get(name, 0.0), share * sure / (1.0 - sure))
    return odds


def _is_described(one: dict[str, Any], known: dict[str, Any]) -> bool:
    """Whether this is what the description says of the vehicle and the sea."""
    effect, sizes = one["effect"], one["parameters"]
    if effect == "wave_torque":
        return bool(known.get("waves"))
    nominal = known.get("thruster_lag_s" if effect in {"thruster_lag", "command_delay"} else effect)
    key = {"thruster_lag": "time_constant", "command_delay": "delay", "advance_speed_loss": "coefficient"}.get(effect)
    if not nominal or key not in sizes:
        return False
    return bool(abs(sizes[key]["value"] - nominal) <= _NOMINAL_ERRORS * (sizes[key]["standard_error"] or 0.0))


def _quantiles(estimate: Any, name: str) -> list[float]:
    """Quantiles by the intervals that rovid gives; a factor of four about a value that the logs do not determine."""
    if name in estimate.refused:
        return [float(estimate.value(name) * 4.0**share) for share in (-1.0, -0.4, 0.0, 0.4, 1.0)]
    edges = [estimate.interval(name, level) for level in (0.8, 0.4)]
    value = estimate.value(name)
    return [max(float(one), 0.0) for one in (edges[0][0], edges[1][0], value, edges[1][1], edges[0][1])]


def _write(campaign: Campaign, folder: Path, *, filled: bool) -> None:
    """A folder for rovid: without the held-out part, or with it and its heading held at the last known value."""
    folder.mkdir()
    description = campaign.description
    lines = ["[vehicle]", f'name = "{campaign.name}"']
    lines += [f"{key} = {value}" for key, value in description["vehicle"].items()]
    for one in description["thrusters"]:
        with (folder / f"curve_{one['name']}.csv").open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([["command", "thrust_N"], *one["curve"]])
        lines += ["[[thrusters]]", f'name = "{one["name"]}"', f"yaw_arm = {one['yaw_arm_m']}",
                  *[f"{share} = {one[share]}" for share in ("surge", "sway") if share in one],
                  f'curve = "curve_{one["name"]}.csv"', f'command = {{ csv = "{one["name"]}" }}']  # fmt: skip
    signals = [
        str(name) for name in campaign.runs[0].table if name not in {one["name"] for one in description["thrusters"]}
    ]
    lines += ["[signals]", 'time = { csv = "time_s" }']
    for name in signals[1:]:
        unit = f', unit = "{_UNITS[name]}"' if name in _UNITS else ""
        lines.append(f'{name.removesuffix("_deg_s").removesuffix("_deg")} = {{ csv = "{name}"{unit} }}')
    if filled:  # A heading that is held is no fault here.
        lines += ["[faults]", 'no_response = "keep"', 'heading_gaps = "keep"', 'foreign_log = "keep"']
    (folder / "rovid.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    for run in campaign.runs:
        table: pd.DataFrame = run.table
        if run is campaign.runs[-1]:
            table = table.ffill() if filled else table[table["time_s"] <= campaign.cut]
        table.to_csv(folder / f"{run.name}.csv", index=False)
