"""Scores of planar campaigns, the page of results, and one campaign in a line of the terminal."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from typing import Any

Record = Mapping[str, Any]
# Names that count as the hidden cause's class: other equations of the catalogue for nearly the same forces.
CLASSES: Mapping[tuple[str, str], frozenset[str]] = {
    ("sway_yaw_damping", "lift"): frozenset({"speed_dependent_damping", "cross_flow_drag"}),
    ("cross_flow_drag", "offset"): frozenset({"sway_yaw_damping"}),
    ("speed_dependent_damping", "linear"): frozenset({"sway_yaw_damping"}),
    ("speed_dependent_damping", "quadratic"): frozenset({"sway_yaw_damping"}),
    ("command_delay", "constant"): frozenset({"thruster_lag"}),
    ("thruster_lag", "thrust"): frozenset({"command_delay"}),
}
# An answer below this share of the true value's scale counts as certain: what is undetermined must not have one.
_CERTAIN = 0.5


def plain(name: str) -> str:
    """Effect of a name that may carry a form or a thruster."""
    return name.partition(":")[0]


def value_of(document: Record, name: str) -> tuple[float, float] | None:
    """Value and standard error of a parameter, or None where it is refused."""
    one = (document.get("parameters") or {}).get(name) or {}
    value, error = one.get("value"), one.get("standard_error")
    if value is None or error is None or not math.isfinite(error) or error <= 0.0:
        return None
    return float(value), float(error)


def errors_of(record: Record) -> dict[str, float]:
    """Errors of the planar fit in standard errors, for parameters that the logs determine, the cause's too."""
    truth, said = record["truth"], record["said"]["fit"]
    found = {}
    for name in truth["comparable"]:
        answer = value_of(said, name)
        if answer and name not in truth["undetermined"]:
            found[name] = (answer[0] - truth["parameters"][name]) / answer[1]
    return found


def effect_errors(record: Record) -> dict[str, float]:
    """Errors of the hidden cause's parameters in standard errors; directions by the shorter way round."""
    truth, said = record["truth"], record["said"]["fit"]
    found = {}
    for name, true in truth["hidden_parameters"].items():
        keys = [key for key in said.get("parameters") or {} if plain(key.rpartition(".")[0]) == truth["hidden"]
                and key.rpartition(".")[2] == name]  # fmt: skip
        answer = value_of(said, keys[0]) if keys else None
        if answer:
            away = answer[0] - true
            if name == "direction":
                away = math.remainder(away, 2.0 * math.pi)
            found[f"{truth['hidden']}.{name}"] = away / answer[1]
    return found


def refusals(record: Record) -> tuple[list[str], list[str], list[str]]:
    """Undetermined parameters that are refused or have an honest error; those with a wrong number; refused in vain."""
    truth, said = record["truth"], record["said"]["fit"]
    right: list[str] = []
    wrong: list[str] = []
    vain: list[str] = []
    if "parameters" not in said:
        return right, wrong, vain
    for name, true in truth["parameters"].items():
        answer = value_of(said, name)
        if name in truth["undetermined"]:
            certain = answer is not None and answer[1] < _CERTAIN * max(abs(answer[0]), abs(true))
            (wrong if certain else right).append(name)
        elif name in truth["determined"] and truth["predicted_relative_errors"][name] < 0.05 and answer is None:
            vain.append(name)
    return right, wrong, vain


def outcome(record: Record) -> str:
    """What the diagnosis said: exact, class, suspect, extra, wrong, missed; clean or false where nothing is hidden."""
    truth, said = record["truth"], record["said"].get("diagnose") or {}
    if "verdict" not in said:
        return "no answer"
    findings, suspects = said.get("findings") or [], said.get("suspects") or []
    if truth["hidden"] is None:
        return "false" if findings else "suspects" if suspects else "clean"
    allowed = {truth["hidden"]} | CLASSES.get((truth["hidden"], truth["form"]), frozenset())
    names = [{plain(name) for name in (one["effect"], *(one.get("cannot_be_told_from") or ()))} for one in findings]
    good = [one & allowed for one in names]
    if findings and all(good):
        exact = len(findings) == 1 and plain(findings[0]["effect"]) == truth["hidden"]
        return "exact" if exact else "class"
    if findings:
        return "extra" if any(good) else "wrong"
    if suspects and plain(suspects[0]["effect"]) in allowed:
        return "suspect"
    return "unexplained" if said["verdict"] == "unexplained" else "missed"


def line_of(record: Record) -> str:
    """One campaign in a line of the terminal."""
    truth, said = record["truth"], record["said"]
    z = errors_of(record)
    worst = max(z, key=lambda name: abs(z[name])) if z else ""
    findings = [one["effect"] for one in (said.get("diagnose") or {}).get("findings") or []]
    seconds = [f"{key} {one['seconds']:.0f} s" for key, one in said.items()]
    failures = [f"{key}: {one['failure'][:120]}" for key, one in said.items() if one["failure"]]
    sensors = "+".join(one["kind"] for one in truth["sensors"])
    return (
        f"{record['seed']}/{record['index']:4d} {truth['family']:<11} {sensors:<18} "
        f"{truth['hidden'] or 'nothing'}:{truth['form'] or ''} {outcome(record)} {findings} "
        f"worst z {z.get(worst, math.nan):.1f} {worst} {', '.join(seconds)} {' '.join(failures)}"
    )


def _share(count: int, total: int) -> str:
    return f"{count} of {total}" + (f" ({100.0 * count / total:.0f} %)" if total else "")


def _bias(records: Sequence[Record], which: str, name: str) -> list[float]:
    found = []
    for record in records:
        answer = value_of(record["said"].get(which) or {}, name)
        if answer and record["truth"]["parameters"]:
            found.append(100.0 * (answer[0] / record["truth"]["parameters"]["yaw.inertia"] - 1.0))
    return found


def _percent(values: Sequence[float]) -> str:
    if not values:
        return "-"
    quarters = statistics.quantiles(values, n=4) if len(values) > 1 else [values[0]] * 3
    return f"{statistics.median(values):+.1f} % (quartiles {quarters[0]:+.1f} and {quarters[2]:+.1f}; {len(values)})"


def _seconds(records: Sequence[Record], which: str) -> str:
    values = [record["said"][which]["seconds"] for record in records if which in record["said"]]
    return f"{statistics.median(values):.0f} s, at most {max(values):.0f} s" if values else "-"


def page(records: Sequence[Record]) -> str:
    """The page of results, Markdown."""
    exact = [one for one in records if one["truth"]["base_exact"]]
    seeds = ", ".join(sorted({str(one["seed"]) for one in records}))
    kinds = [one["truth"]["family"] for one in records]
    families = ", ".join(f"{kinds.count(kind)} {kind}" for kind in sorted(set(kinds)))
    intro = f"""# Results of the coupled model

Written by `python -m benchmarks.planar`. A program that shares no code with rovid simulates vehicles in surge, sway and
yaw. rovid reads only the files. There are {len(records)} campaigns of seed {seeds}: {families}. In {len(exact)} of them
the base model is exact up to the disturbance and the hidden cause. An `auv_rudder` has fins, and a tanker has the hull
of the MMG model.
"""
    z: dict[str, list[float]] = {}
    for record in exact:
        for name, value in (errors_of(record) | effect_errors(record)).items():
            z.setdefault(name, []).append(value)
    errors = [
        (name, len(some), _within(some), f"{statistics.median(some):+.1f}", f"{max(some, key=abs):+.1f}")
        for name, some in sorted(z.items())
    ]
    groups: dict[str, list[str]] = {}
    for record in exact:
        key = f"{record['truth']['hidden'] or 'nothing'} {record['truth']['form'] or ''}".strip()
        groups.setdefault(key, []).append(outcome(record))
    causes = [
        (key, len(some), ", ".join(f"{word} {some.count(word)}" for word in sorted(set(some))))
        for key, some in sorted(groups.items())
    ]
    return "\n".join([
        intro, _table(("measure", "result"), _measures(records, exact)),
        "Errors in standard errors:\n",
        _table(("parameter", "campaigns", "within two", "median", "largest"), errors),
        "Diagnosis by hidden cause:\n", _table(("cause", "campaigns", "outcomes"), causes).rstrip() + "\n",
    ])  # fmt: skip


def _within(values: Sequence[float]) -> int:
    return sum(abs(value) <= 2.0 for value in values)


def _table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in row) + " |" for row in lines) + "\n"


def _measures(records: Sequence[Record], exact: Sequence[Record]) -> list[tuple[str, str]]:
    """Names and results of the measures."""
    base = [value for record in exact for value in errors_of(record).values()]
    causes = [value for record in exact for value in effect_errors(record).values()]
    right, wrong, vain = (sum(len(refusals(one)[k]) for one in records) for k in range(3))
    results = [outcome(one) for one in exact if one["truth"]["hidden"] and "diagnose" in one["said"]]
    calm = [outcome(one) for one in exact if not one["truth"]["hidden"] and "diagnose" in one["said"]]
    named = results.count("exact") + results.count("class")
    failed = sum(bool(part["failure"]) for one in records for part in one["said"].values())
    return [
        ("base parameters within two standard errors, fit with the true cause", _share(_within(base), len(base))),
        ("parameters of the cause within two standard errors", _share(_within(causes), len(causes))),
        ("error of the yaw inertia, coupled model", _percent(_bias(exact, "fit", "yaw.inertia"))),
        ("error of the yaw inertia, yaw alone", _percent(_bias(exact, "yaw", "inertia"))),
        ("hidden cause named", f"{_share(named, len(results))}, {results.count('exact')} of them alone"),
        ("hidden cause the first suspect", str(results.count("suspect"))),
        ("hidden cause not named, but reported as unexplained", str(results.count("unexplained"))),
        ("a wrong cause named next to the hidden cause, or in its place",
         f"{results.count('extra')} and {results.count('wrong')}"),
        ("nothing hidden, a false cause", _share(calm.count("false"), len(calm))),
        ("undetermined parameters refused, or with a large error", _share(right, right + wrong)),
        ("parameters refused that the logs determine within 5 %", str(vain)),
        ("processor time of the fit, on one core", _seconds(records, "fit")),
        ("processor time of the diagnosis, on one core", _seconds(records, "diagnose")),
        ("commands without an answer", str(failed)),
    ]  # fmt: skip
