"""Scores of one wide campaign: what rovid said of it against the truth."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from tools.wide.causes import ALL

# Our laws that another effect of the catalogue describes as well as the effect of the same name. Two lags in series are
# nearly a lag and a delay, within a few per cent. A smooth dead band is a nonlinear curve. A sag that follows the load
# at once is a function of the thrust. The torque of a tether with a fixed slack heading depends on the heading.
CLASSES: Mapping[tuple[str, str], frozenset[str]] = {
    ("thruster_lag", "series"): frozenset({"command_delay"}),
    ("thruster_deadband", "smooth"): frozenset({"thrust_curve_shape"}),
    ("supply_sag", "load"): frozenset({"thrust_curve_shape"}),
    ("tether_torsion", "rest"): frozenset({"heading_dependent_torque"}),
}
# Our law -> form of the catalogue (None: the default one) with the same equation, where parameters are compared.
LAWS: Mapping[tuple[str, str], str | None] = {
    ("thruster_deadband", "hard"): None,
    ("thruster_deadband", "jump"): "jump",
    ("thrust_asymmetry", "gain"): None,
    ("thrust_curve_shape", "power"): None,
    ("thrust_curve_shape", "saturating"): "saturating",
    ("thrust_curve_shape", "command"): "command",
    ("supply_sag", "load"): None,
    ("supply_sag", "drift"): "drift",
    ("supply_sag", "day"): "day",
    ("supply_sag", "voltage"): "voltage",
    ("thruster_lag", "torque"): None,
    ("thruster_lag", "command"): "command",
    ("thruster_lag", "spin"): "spin",
    ("thruster_lag", "rotor"): "rotor",
    ("command_delay", "constant"): None,
    ("slew_limit", "hard"): None,
    ("slew_limit", "soft start"): "soft_start",
    ("command_hysteresis", "play"): None,
    ("command_hysteresis", "switch"): "schmitt",
    ("advance_speed_loss", "own turn"): None,
    ("advance_speed_loss", "measured"): "across",
    ("bias_torque", "constant"): None,
    ("drag_curvature", "cubic"): None,
    ("drag_curvature", "exponent"): "exponent",
    ("drag_asymmetry", "all"): None,
    ("drag_asymmetry", "quadratic"): "quadratic",
    ("coulomb_resistance", "sharp"): None,
    ("coulomb_resistance", "tanh"): None,
    ("oscillatory_drag", "exponential"): None,
    ("oscillatory_drag", "algebraic"): "algebraic",
    ("added_mass_memory", "one time"): None,
    ("entrained_swirl", "first order"): None,
    ("tether_torsion", "linear"): None,
    ("tether_torsion", "stiffening"): "stiffening",
    ("heading_dependent_torque", "one cycle"): None,
    ("heading_dependent_torque", "two cycles"): "two_cycles",
    ("wave_torque", "sine"): None,
    ("wave_torque", "narrow band"): None,
    ("tank_seiche", "acceleration"): None,
    ("tank_seiche", "thrust"): "thrust",
    ("heading_deviation", "one cycle"): None,
    ("heading_deviation", "two cycles"): "two_cycles",
    ("speed_dependent_damping", "linear"): None,
    ("speed_dependent_damping", "quadratic"): "quadratic",
    ("sideslip_moment", "drift"): None,
    ("sideslip_moment", "munk"): "munk",
}
# Fault of logs that looks the same as a delay.
CLOCKS = "clocks_apart"
# From good to bad.
OUTCOMES = ("exact", "class", "suspect first", "extra", "wrong", "unexplained", "missed", "no answer")
OUTCOMES_NOTHING = ("clean", "suspects", "unexplained", "false", "no answer")
ANSWERS = frozenset({"found", "suspected", "nothing_found", "unexplained"})


def plain(name: str) -> str:
    """Effect of a name that may carry a form or a thruster."""
    return name.partition(":")[0]


def names_of(finding: Mapping[str, Any]) -> frozenset[str]:
    """The effect of a finding and the effects that it cannot be told from."""
    return frozenset(plain(name) for name in (finding["effect"], *finding["cannot_be_told_from"]))


def score(record: Mapping[str, Any]) -> dict[str, Any]:
    """Outcome, false names among the established ones, and errors in standard errors."""
    truth, said = record["truth"], record["said"]["diagnose"]
    hidden = truth["effect"]
    findings, suspects = said.get("findings") or [], said.get("suspects") or []
    right = {hidden} | CLASSES.get((hidden, truth["form"]), frozenset())
    false = [plain(one["effect"]) for one in findings if hidden is None or not names_of(one) & right]
    return {
        "outcome": _outcome(said, hidden, right, findings, suspects, false),
        "false": false,
        "findings": [finding_name(one) for one in findings],
        "suspects": [finding_name(one) for one in suspects],
        "z": errors_of(said.get("extended") or said.get("base") or {}, truth),
        "fit_z": errors_of(record["said"].get("fit") or {}, truth),
        "effect_z": effect_errors(findings, truth),
    }


def _outcome(
    said: Mapping[str, Any], hidden: str | None, right: set[str], findings: list[Any], suspects: list[Any],
    false: list[str],
) -> str:  # fmt: skip
    verdict = said.get("verdict")
    if verdict not in ANSWERS:
        return "no answer"
    if hidden is None:
        return (
            "false" if findings else "suspects" if suspects else "unexplained" if verdict == "unexplained" else "clean"
        )
    if findings:
        if false:
            return "wrong" if len(false) == len(findings) else "extra"
        only = len(findings) == 1 and findings[0]["effect"] == hidden and not findings[0]["cannot_be_told_from"]
        return "exact" if only else "class"
    if suspects and names_of(suspects[0]) & right:
        # Stamps of two clocks do not tell a delay from an offset of the clocks: both are named, neither is established.
        return "class" if CLOCKS in names_of(suspects[0]) else "suspect first"
    return "unexplained" if verdict == "unexplained" else "missed"


def finding_name(finding: Mapping[str, Any]) -> str:
    """A finding in a word: effect, form, confidence, and what it cannot be told from."""
    form = f":{finding['form']}" if finding.get("form") else ""
    others = "".join(f" or {name}" for name in finding["cannot_be_told_from"])
    return f"{finding['effect']}{form}{others} {finding['confidence']:.2f}"


def _error(estimate: Mapping[str, Any], true: float, sign: bool = True) -> float | None:
    value, error = estimate.get("value"), estimate.get("standard_error")
    if value is None or error is None or not math.isfinite(error) or error <= 0.0:
        return None
    away = (value - true) if sign else (abs(value) - abs(true))
    return float(away / error)


def errors_of(model: Mapping[str, Any], truth: Mapping[str, Any]) -> dict[str, float]:
    """Errors of inertia and drags in standard errors, where the truth is defined and an error was stated."""
    found = {}
    for name in ALL:
        if name in truth["comparable"]:
            z = _error((model.get("parameters") or {}).get(name) or {}, truth[name])
            if z is not None:
                found[name] = z
    return found


def effect_errors(findings: list[Any], truth: Mapping[str, Any]) -> dict[str, float]:
    """Errors of the hidden effect's parameters in standard errors, where the finding has the law that was drawn."""
    found = {}
    law = (truth["effect"], truth["form"])
    for finding in findings:
        form = finding.get("form")
        same = law in LAWS and LAWS[law] == form
        if law == ("thruster_imbalance", "gain"):
            same = form == truth["weak_thruster"]
        if finding["effect"] != truth["effect"] or not same:
            continue
        for name, true in truth["parameters"].items():
            z = _error(finding["parameters"].get(name) or {}, true, sign=name != "amplitude")
            if z is not None:
                found[name] = z
    return found
