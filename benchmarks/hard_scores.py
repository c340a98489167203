"""What a diagnosis of a hard-water campaign is worth: names, odds and parameters against the truth."""

from __future__ import annotations

import math
from typing import Any

# Effects that such logs cannot tell apart, or hardly: naming one for another of its class counts as the class.
CLASSES: tuple[frozenset[str], ...] = (
    frozenset({"thruster_lag", "command_delay", "slew_limit", "added_mass_memory"}),  # something is late
    frozenset({"bias_torque", "thrust_asymmetry", "drag_asymmetry"}),  # one way is unlike the other
    frozenset({"drag_curvature", "advance_speed_loss"}),  # drag grows otherwise than it should
    frozenset({"advance_speed_loss", "speed_dependent_damping"}),  # way on damps the turn
    frozenset({"entrained_swirl", "tether_torsion"}),  # a turn that goes on is held back
    frozenset({"oscillatory_drag", "added_mass_memory"}),  # the water remembers a reversal
)
# Where every run turns one way.
ONE_WAY_CLASSES: tuple[frozenset[str], ...] = (
    frozenset({"bias_torque", "thrust_asymmetry", "drag_asymmetry", "coulomb_resistance", "thruster_deadband"}),
    frozenset({"drag_curvature", "coulomb_resistance", "thrust_curve_shape", "thruster_deadband"}),
)
# What is hidden under a name of the simulator's own, and the catalogue's names for it.
NAMES = {"trial_scale": frozenset({"trial_scale", "trial_variation", "thrust_scale_by_trial", "supply_sag"})}
# Of the torque in use; waves show in a spectrum long before they move the heading far.
WAVES = 0.01
# What every vehicle's thrusters have, and may be measured: effect -> its parameter and the truth's name of that.
NOMINAL = {
    "thruster_lag": ("time_constant", "rotor_seconds"),
    "command_delay": ("delay", "rotor_seconds"),
    "advance_speed_loss": ("coefficient", "advance_loss"),
}
# Measured is what is found within so many standard errors.
NOMINAL_ERRORS = 3.0
# What goes by a speed.
BY_SPEED = frozenset({"advance_speed_loss", "sideslip_moment", "speed_dependent_damping"})
# Causes with which a model knows that the rotors are late.
LATE = frozenset(effect for effect, (_, known) in NOMINAL.items() if known == "rotor_seconds")
VISIBILITY = ((0.5, "half or more"), (0.25, "a quarter to a half"), (0.1, "a tenth to a quarter"), (-9.0, "less"))
PARAMETERS = ("inertia", "quadratic_drag", "linear_drag")


def visibility(truth: dict[str, Any]) -> str:
    """By how much the cause, known, would lower the heading error; in words."""
    if truth["hidden"] is None:
        return "nothing hidden"
    return next(name for least, name in VISIBILITY if truth["visible"] >= least)


def same_class(named: str, hidden: str, one_way: bool) -> bool:
    """Whether two effects are of one class."""
    classes = CLASSES + (ONE_WAY_CLASSES if one_way else ())
    return any(named in members and hidden in members for members in classes)


def verdict_on(named: dict[str, Any], truth: dict[str, Any]) -> str:
    """What a finding or a suspect is worth: "exact", "class", "there" (it is always there and shows) or "wrong"."""
    effect = named["effect"]
    if truth["hidden"] is not None:
        hidden = truth["hidden"]["effect"]
        names = NAMES.get(hidden, frozenset({hidden}))
        if effect in names:
            return "exact"
        rivals = _rivals(named)
        if names & rivals or any(same_class(effect, name, truth["one_way"]) for name in names):
            return "class"
    return "there" if {effect, *_rivals(named)} & _there(truth) or _is_nominal(named, truth) else "wrong"


def is_strictly_right(named: dict[str, Any], truth: dict[str, Any]) -> bool:
    """Whether it is the hidden effect itself, or shows by a twentieth of the heading error: no class, no rivals."""
    hidden = {truth["hidden"]["effect"]} if truth["hidden"] else set()
    return named["effect"] in {*hidden, *truth["also_true"]}


def acts_itself(named: dict[str, Any], truth: dict[str, Any]) -> bool:
    """Whether what is named acts itself, and is no more than of a class with what does."""
    waves = named["effect"] == "wave_torque" and "wave_torque" in _there(truth)
    return waves or is_strictly_right(named, truth) or verdict_on({"effect": named["effect"]}, truth) == "exact"


def _is_nominal(named: dict[str, Any], truth: dict[str, Any]) -> bool:
    """Whether what is named is what the vehicle's own thrusters have, in its size."""
    parameter, known = NOMINAL.get(named["effect"], ("", ""))
    size, nominal = (named.get("parameters") or {}).get(parameter), truth.get(known, 0.0)
    if size is None or not nominal:
        return False
    off = within(size["value"], size["standard_error"], nominal)
    return off is not None and abs(off) <= NOMINAL_ERRORS


def _rivals(named: dict[str, Any]) -> set[str]:
    rivals = named.get("cannot_be_told_from") or []
    return {rival if isinstance(rival, str) else rival["effect"] for rival in rivals}


def _there(truth: dict[str, Any]) -> set[str]:
    """What acts though it was not hidden: what lowers the heading error, and waves wherever there are any."""
    waves = {"wave_torque"} if truth.get("waves", 0.0) >= WAVES else set()
    return {*truth["also_true"], *waves}


def within(value: float, error: float | None, truth: float) -> float | None:
    """Distance from the truth in stated standard errors."""
    if not error or not math.isfinite(error):
        return None
    return (value - truth) / error


def score(record: dict[str, Any]) -> dict[str, Any]:
    """Names, rank, odds and parameters of one campaign."""
    truth, said = record["truth"], record["said"]
    result: dict[str, Any] = {
        "number": record["number"], "visibility": visibility(truth), "vehicle": truth["vehicle"],
        "hidden": truth["hidden"]["effect"] if truth["hidden"] else None, "answer": said is not None,
    }  # fmt: skip
    findings = said["findings"] if said else []
    suspects = (said.get("suspects") or []) if said else []
    established = [verdict_on(one, truth) for one in findings]
    ranked = [verdict_on(one, truth) for one in [*findings, *suspects]]
    hits = [index for index, worth in enumerate(ranked) if worth in {"exact", "class"}]
    # What is always there may well be named before what was hidden.
    counted = [worth for worth in ranked if worth != "there"]
    result |= {
        "unlogged": result["hidden"] in BY_SPEED and not truth["speed_logged"],
        "verdict": said["verdict"] if said else record["failure"],
        "names": [one["effect"] for one in findings],
        "suspected": [one["effect"] for one in suspects],
        "established": established,
        "strictly": [is_strictly_right(one, truth) for one in findings],
        "established_right": any(worth in {"exact", "class"} for worth in established),
        "established_wrong": "wrong" in established,
        "first_right": bool(counted) and counted[0] in {"exact", "class"},
        "rank": hits[0] + 1 if hits else None,
        "odds": [
            (float(one["confidence"]), worth != "wrong", acts_itself(one, truth))
            for one, worth in zip([*findings, *suspects], ranked, strict=True)
            if one.get("confidence") is not None
        ],
        "parameters": {},
    }
    if said:
        model = said["extended"] if findings and said.get("extended") else said["base"]
        best = truth["late_fit" if LATE & set(result["names"]) else "told_fit"]
        for name in PARAMETERS:
            read = (model or {}).get("parameters", {}).get(name)
            if read and read.get("value") is not None:
                error = read.get("standard_error")
                result["parameters"][name] = {
                    "ratio": read["value"] / truth["parameters"][name],
                    "errors_from_hull": within(read["value"], error, truth["parameters"][name]),
                    "errors_from_best": within(read["value"], error, best[name]),
                }
    return result


Odds = list[tuple[float, bool, bool]]


def reliability(odds: Odds) -> tuple[list[tuple[int, float, float, float]], float | None]:
    """Ten bins of (number, mean confidence, share whose class acts, share that acts itself), and the Brier score."""
    bins: list[Odds] = [[] for _ in range(10)]
    for one in odds:
        bins[min(int(one[0] * 10), 9)].append(one)
    table = []
    for few in bins:
        mean, acting, itself = (sum(column) / len(few) for column in zip(*few, strict=True)) if few else [math.nan] * 3
        table.append((len(few), mean, acting, itself))
    brier = sum((confidence - acts) ** 2 for confidence, acts, _ in odds) / len(odds) if odds else None
    return table, brier
