"""Pairs of campaigns in which something changed, or nothing: does `rovid compare` say so, and how sure are its ratios?

Run ``python -m benchmarks.compare --seed 1 --vehicles 50 --state compare.jsonl``. Each vehicle is drawn anew and tried
once as it is; then once with drag 10 % higher, once with a thruster at 0.85 of its thrust, once with a lag, and three
times as it was: six pairs. Each day has a constant torque, levels and a disturbance of its own. The simulator is that
of tools/, which shares nothing with rovid. With ``--water hard`` it is that of tools/hard: waves, feedback, coupling
and short logs, each vehicle three times as it was, in other weather, with other runs and instruments.

Started again with the same state it goes on where it stopped. ``--again`` judges what the state holds without a fit.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rovid.compare.difference_tests import DifferenceTest, EstimatePair, change_candidates, find_changes
from tools.hard import draw, write_campaign
from tools.hidden import Hidden
from tools.programme import Hold, Run, Sine, multilevel
from tools.trial_day import write_trial_day
from tools.truth import ROSUB, Disturbance, Instruments, Truth

KINDS = ("drag", "thruster", "lag", "nothing", "nothing", "nothing")
DRAG, GAIN = 1.1, 0.85
_BASE = ("inertia", "quadratic_drag", "linear_drag")
_SURE = 1.959964


def vehicle_of(seed: int, number: int) -> tuple[Truth, float, bool]:
    """A vehicle, the lag that it may get, and whether its thrusters are ever driven one by one."""
    rng = np.random.default_rng([seed, number])
    inertia, quadratic, linear = (float(rng.uniform(0.7, 1.4)) for _ in range(3))
    old = ROSUB.dynamics
    dynamics = replace(
        old,
        inertia=inertia * old.inertia,
        quadratic_drag=quadratic * old.quadratic_drag,
        linear_drag=linear * old.linear_drag,
    )
    truth = replace(
        ROSUB,
        dynamics=dynamics,
        instruments=Instruments(rate=10.0),
        disturbance=Disturbance(standard_deviation=float(rng.uniform(1.0, 4.0))),
    )
    return truth, float(rng.uniform(0.25, 0.6)), bool(rng.random() < 0.75)


def programme(rng: np.random.Generator, *, apart: bool) -> tuple[Run, ...]:
    """The runs of one day, some ten minutes; each day has levels of its own."""
    share = float(rng.uniform(0.9, 1.1))
    runs = [
        Run(name="hold_ahead", pieces=(Hold(1.6 * share, 50.0), Hold(0.0, 12.0), Hold(1.1 * share, 50.0))),
        Run(name="hold_back", pieces=(Hold(-1.3 * share, 50.0), Hold(-2.1 * share, 50.0))),
        Run(name="sine_20s", pieces=(Sine(2.0 * share, 2.5 * share, 20.0, 4),)),
        Run(name="sine_40s", pieces=(Sine(1.6 * share, 2.2 * share, 40.0, 3),)),
        Run(name="steps", pieces=tuple(Hold(v * share, 10.0) for v in (1.55, -1.97, 1.94, 0.0, -1.67, 1.04, -2.4))),
        Run(name="levels", pieces=multilevel(100.0)),
    ]
    if apart:
        runs += [
            Run(name=f"{one}_only", pieces=(Hold(2.2, 25.0), Hold(-2.7, 25.0)), only=one) for one in ("fore", "aft")
        ]
    return tuple(runs)


def changed(truth: Truth, kind: str, lag: float) -> Truth:
    """``truth`` with what happened to it."""
    if kind == "drag":
        old = truth.dynamics
        drag = replace(old, quadratic_drag=DRAG * old.quadratic_drag, linear_drag=DRAG * old.linear_drag)
        return replace(truth, dynamics=drag)
    happened = {
        "thruster": Hidden(effect="thruster_imbalance", form="gain", parameters={"gain": GAIN}, thruster="fore"),
        "lag": Hidden(effect="thruster_lag", form="first_order", parameters={"time_constant": lag}),
    }
    return replace(truth, hidden=(*truth.hidden, happened[kind])) if kind in happened else truth


def write_day(folder: Path, truth: Truth, seed: list[int], *, apart: bool) -> None:
    """One day of ``truth``, with a constant torque of the day."""
    rng = np.random.default_rng(seed)
    bias = Hidden(effect="bias_torque", form="constant", parameters={"torque": float(rng.normal(0.0, 2.0))})
    day = replace(truth, hidden=(*truth.hidden, bias))
    write_trial_day(
        folder, seed=int(rng.integers(1 << 30)), formats="csv", truth=day, campaign=programme(rng, apart=apart)
    )


def calm(seed: int, number: int, room: Path) -> tuple[list[tuple[str, Path]], dict[str, Any]]:
    """Days of one vehicle, the first unchanged and each other with one change, and the truth."""
    truth, lag, apart = vehicle_of(seed, number)
    days = []
    for at, kind in enumerate(("", *KINDS)):
        folder = room / f"day_{at}"
        write_day(folder, changed(truth, kind, lag), [seed, number, at], apart=apart)
        days.append((kind, folder))
    return days, {"lag": lag, "apart": apart}


def hard(seed: int, number: int, room: Path) -> tuple[list[tuple[str, Path]], dict[str, Any]]:
    """Three days of one vehicle in hard water, by tools/hard: other weather, instruments and runs, and no change."""
    first = draw(100_000 * seed + 10 * number, effect="none")
    days = [("", first), *(("nothing", draw(first.seed + at, first.vehicle, "none")) for at in (1, 2))]
    for at, (_, campaign) in enumerate(days):
        write_campaign(room / f"day_{at}", campaign)
    return [(kind, room / f"day_{at}") for at, (kind, _) in enumerate(days)], {"lag": 0.0, "apart": True}


def judged(seed: int, number: int, water: str) -> dict[str, Any]:
    """One vehicle: its days diagnosed, each pair compared."""
    from rovid.compare.campaign_fit import campaign_from_study, with_diagnosis
    from rovid.compare.comparison import compare
    from rovid.core.errors import DataError
    from rovid.store.study import open_study

    began = time.monotonic()
    pairs, refused = [], 0
    with tempfile.TemporaryDirectory() as room:
        folders, truth = (hard if water == "hard" else calm)(seed, number, Path(room))
        days = []
        for kind, folder in folders:
            try:
                days.append((kind, with_diagnosis(campaign_from_study(open_study([folder]), folder.name))))
            except DataError:
                refused += 1
        for kind, day in days[1:]:
            try:
                said = compare(days[0][1], day)
            except DataError:
                refused += 1
                continue
            pairs.append(
                {
                    "kind": kind,
                    "verdict": said.verdict,
                    "changed": said.changed,
                    "causes": said.causes,
                    "found": _found(said.changes),
                    "seen": dict(said.changes.detectable_changes),
                    "why": said.open_questions,
                    "pair": {key: _listed(value) for key, value in vars(said.changes.pair).items()},
                    "r2": {f"{one} on {other}": each.rate_r2 for (one, other), each in said.predictions.items()},
                }
            )
    seconds = time.monotonic() - began
    head = {"seed": seed, "number": number, "water": water, **truth}
    return {**head, "pairs": pairs, "refused": refused, "seconds": seconds}


def _found(changes: DifferenceTest) -> list[tuple[str, float, float, float]]:
    return [(one.candidate.name, one.confidence, one.ratio, one.standard_error) for one in changes.changes]


def _listed(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value


def truth_of(record: dict[str, Any], kind: str) -> dict[str, float]:
    """Name of each parameter -> B over A of it, or of what is no factor B less A."""
    scale = 1.0 if record["apart"] or kind != "thruster" else 2.0 / (1.0 + GAIN)
    drag = DRAG if kind == "drag" else 1.0
    return {
        "inertia": scale,
        "quadratic_drag": scale * drag,
        "linear_drag": scale * drag,
        "thruster_lag.time_constant": record["lag"] if kind == "lag" else 0.0,
        "thruster_imbalance:fore.gain": GAIN - 1.0 if kind == "thruster" else 0.0,
    }


def right(record: dict[str, Any], pair: dict[str, Any]) -> bool:
    """Whether what changed was named, and nothing else."""
    kind, names = pair["kind"], set(pair["changed"])
    if kind == "nothing":
        return str(pair["verdict"]) == "same"
    if kind == "drag":
        return bool(names) and names <= {"quadratic_drag", "linear_drag"}
    if kind == "lag":
        return names == {"thruster_lag.time_constant"} and "thruster_lag" in pair["causes"][1]
    return names == ({"thruster_imbalance:fore.gain"} if record["apart"] else {"thrust_scale"})


def falsely(record: dict[str, Any], pair: dict[str, Any]) -> bool:
    """Whether something was called changed that is as it was."""
    return pair["verdict"] == "changed" and not right(record, pair)


def errors(record: dict[str, Any], pair: dict[str, Any]) -> Iterator[tuple[str, float]]:
    """Of each difference, what it is off the truth by, in its standard errors."""
    truth, given = truth_of(record, pair["kind"]), pair["pair"]
    for at, name in enumerate(given["names"]):
        if name not in truth:
            continue
        variances = given["covariance_a"][at][at], given["covariance_b"][at][at]
        a, b = given["a"][at], given["b"][at]
        if name in _BASE and not abs(a) > 3.0 * math.sqrt(variances[0]):
            # No ratio is printed.
            yield name, (b - truth[name] * a) / math.sqrt(variances[1] + truth[name] ** 2 * variances[0])
        elif name in _BASE:
            # The ratio as it is printed, to first order.
            error = math.sqrt(variances[1] + (b / a) ** 2 * variances[0]) / abs(a)
            yield name, (b / a - truth[name]) / error
        else:
            yield name, (b - a - truth[name]) / math.sqrt(sum(variances))


def again(pair: dict[str, Any], *, apart: bool) -> dict[str, Any]:
    """``pair`` with what is said of its estimates now."""
    given = pair["pair"]
    estimates = EstimatePair(
        names=tuple(given["names"]),
        units=tuple(given["units"]),
        a=np.array(given["a"]),
        b=np.array(given["b"]),
        covariance_a=np.array(given["covariance_a"]),
        covariance_b=np.array(given["covariance_b"]),
        white=bool(given["white"]),
        samples=int(given["samples"]),
    )
    weak = [name.rpartition(".")[0] for name in estimates.names if name.startswith("thruster_imbalance")]
    other = "thruster_imbalance:aft" if weak and apart else ""
    found = find_changes(estimates, change_candidates(estimates, weak, other))
    names: list[str] = []
    for change in found.established:
        names += [change.candidate.name] if change.candidate.inverse else change.candidate.parameters
    verdict = "changed" if names else "cannot_tell" if found.changes or pair["why"] else "same"
    listed = [(one.candidate.name, one.confidence, one.ratio, one.standard_error) for one in found.changes]
    return {
        **pair,
        "changed": list(dict.fromkeys(names)),
        "verdict": verdict,
        "found": listed,
        "seen": dict(found.detectable_changes),
    }


def summary(records: list[dict[str, Any]]) -> str:
    """The scores as text."""
    lines = [f"{len(records)} vehicles, {sum(len(one['pairs']) for one in records)} pairs"]
    for kind in dict.fromkeys(KINDS):
        pairs = [(record, pair) for record in records for pair in record["pairs"] if pair["kind"] == kind]
        good = sum(right(*one) for one in pairs)
        wrong = sum(falsely(*one) for one in pairs)
        open_ = sum(pair["verdict"] == "cannot_tell" for _, pair in pairs)
        lines.append(
            f"{kind:<10} {len(pairs):4d} pairs: right {good}, something named wrongly {wrong}, cannot tell {open_}"
        )
    for name in truth_of({"apart": True, "lag": 0.0}, ""):
        off = [
            abs(z) for record in records for pair in record["pairs"] for one, z in errors(record, pair) if one == name
        ]
        if off:
            inside = sum(z < _SURE for z in off)
            lines.append(
                f"{name:<30} 95 % interval of the difference holds {inside} of {len(off)}, "
                f"{100 * inside / len(off):.1f} %"
            )
    return "\n".join(lines)


def read_state(path: Path, seed: int, water: str) -> list[dict[str, Any]]:
    """Vehicles that are done already; a last line that was cut short is left out."""
    records = []
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        try:
            records.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return [one for one in records if one["seed"] == seed and one.get("water", "calm") == water]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--vehicles", type=int, default=4)
    parser.add_argument("--water", choices=("calm", "hard"), default="calm")
    parser.add_argument("--state", type=Path, required=True, help="a file of JSON lines, added to")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--again", action="store_true", help="judge the estimates in the state anew, and make no more")
    options = parser.parse_args()
    done = read_state(options.state, options.seed, options.water)
    if options.again:
        for record in done:
            record["pairs"] = [again(pair, apart=record["apart"]) for pair in record["pairs"]]
        print(summary(done))
        return
    wanted = sorted(set(range(options.vehicles)) - {record["number"] for record in done})
    os.environ.setdefault("NUMBA_NUM_THREADS", "1")
    options.state.parent.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(options.jobs) as pool, options.state.open("a", encoding="utf-8") as state:
        for finished in as_completed([pool.submit(judged, options.seed, number, options.water) for number in wanted]):
            record = finished.result()
            done.append(record)
            state.write(json.dumps(record) + "\n")
            state.flush()
            said = [f"{one['kind']}: {one['verdict']} {one['changed']}" for one in record["pairs"]]
            print(record["number"], f"{record['seconds']:.0f} s", *said, sep=" | ", flush=True)
    print(summary(done))


if __name__ == "__main__":
    main()
