"""Scores answers to a round: ``python -m benchmarks.challenge.score ROUND ANSWERS.json`` (numpy and pandas suffice).

ROUND holds the campaigns' folders and truth.json, once it is revealed. The answers are those of docs/challenge.md.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.challenge.rules import LABELS, LEVELS, NONE, PARAMETERS, Answer

FLOOR = 1e-3  # least probability that is scored
FALSE_ALARM, SILENCE = 5.0, 1.0  # cost of naming a cause that does not act, and of naming none where one acts
Truth = dict[str, Any]


def crps(quantiles: Sequence[float], truth: float) -> float:
    """Continuous ranked probability score by the pinball loss of equally weighted quantiles (Gneiting 2007)."""
    error = truth - np.sort(np.asarray(quantiles, dtype=float))
    return float(2.0 * np.mean(np.maximum(np.array(LEVELS) * error, (np.array(LEVELS) - 1.0) * error)))


def problem(answer: Any, instants: int) -> str:
    """What is wrong with an answer, which asks for the heading at so many instants; empty if nothing."""
    if not isinstance(answer, dict) or not all(isinstance(answer.get(key), dict) for key in ("causes", "parameters")):
        return "causes, parameters and heading_deg were expected; the first two are objects."
    odds, turns = answer["causes"], answer.get("heading_deg")
    if unknown := set(odds) - set(LABELS):
        return f"causes has {sorted(unknown)[0]!r}; one of these was expected: {', '.join(LABELS)}."
    if not _numbers([*odds.values()], len(odds)) or min(odds.values(), default=-1.0) < 0.0:
        return "each of causes needs a probability from 0 to 1."
    if abs(sum(odds.values()) - 1.0) > 1e-6:
        return f"the probabilities in causes sum to {sum(odds.values()):.6g}; 1 was expected."
    if not isinstance(turns, list) or len(turns) != instants:
        return f"heading_deg needs {instants} lists, one for each of times_s."
    complete = all(_numbers(one, len(LEVELS)) for one in [*map(answer["parameters"].get, PARAMETERS), *turns])
    return "" if complete else f"each parameter and heading needs {len(LEVELS)} quantiles, at the levels {LEVELS}."


def _numbers(values: object, count: int) -> bool:
    """Whether the values are so many finite numbers."""
    return (
        isinstance(values, list)
        and len(values) == count
        and all(isinstance(value, int | float) and math.isfinite(value) for value in values)
    )


def named(odds: Mapping[str, float]) -> str | None:
    """The cause that an answer names: the most probable, if this costs less on average than silence."""
    cause = max((label for label in LABELS if label != NONE), key=lambda label: odds.get(label, 0.0))
    return cause if FALSE_ALARM * (1.0 - odds.get(cause, 0.0)) < SILENCE * (1.0 - odds.get(NONE, 0.0)) else None


def score(answer: Answer | None, truth: Truth) -> dict[str, Any]:
    """Scores of one campaign; without an answer the probabilities are equal, and nothing is named."""
    actual = truth["cause"]
    odds = answer["causes"] if answer else dict.fromkeys(LABELS, 1.0 / len(LABELS))
    p, name = odds.get(actual, 0.0), named(odds)
    cost = FALSE_ALARM if name not in {None, actual} else SILENCE if name is None and actual != NONE else 0.0
    result: dict[str, Any] = {
        "answered": answer is not None, "simulator": truth["simulator"], "cause": actual, "p": p,
        "log_score": -math.log(max(p, FLOOR)), "first": max(odds, key=lambda label: odds[label]) == actual,
        "named": name, "cost": cost, "false": name not in {None, actual},
    }  # fmt: skip
    if answer:
        sizes = [crps(answer["parameters"][key], truth["parameters"][key]) / truth["parameters"][key]
                 for key in PARAMETERS if truth["parameters"].get(key)]  # fmt: skip
        turns = [crps(quantiles, turn) for quantiles, turn in zip(answer["heading_deg"], truth["turns"], strict=True)]
        size = math.sqrt(sum(turn**2 for turn in truth["turns"]) / len(turns))
        result |= {"parameters": float(np.mean(sizes)) if sizes else None, "heading": float(np.mean(turns)) / size}
    return result


def summary(scores: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Scores of an entrant over some campaigns."""

    def median(key: str) -> float:
        known = [one[key] for one in scores if one.get(key) is not None]
        return float(np.median(known)) if known else math.nan

    return {
        "campaigns": len(scores), "answered": sum(one["answered"] for one in scores), "median_p": median("p"),
        "log_score": float(np.mean([one["log_score"] for one in scores])),
        "first": float(np.mean([one["first"] for one in scores])),
        "false": sum(one["false"] for one in scores), "cost": float(np.mean([one["cost"] for one in scores])),
        "parameters": median("parameters"), "heading": median("heading"),
    }  # fmt: skip


def scored(document: dict[str, Any], truths: dict[str, Truth]) -> dict[str, dict[str, Any]]:
    """Campaign -> its scores; a wrong answer raises ValueError with the campaign and the reason."""
    for campaign, answer in document["campaigns"].items():
        if campaign in truths and (wrong := problem(answer, len(truths[campaign]["turns"]))):
            raise ValueError(f"{campaign}: {wrong}")
    return {name: score(document["campaigns"].get(name), truth) for name, truth in truths.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("round", type=Path)
    parser.add_argument("answers", type=Path, nargs="+")
    options = parser.parse_args()
    truths = json.loads((options.round / "truth.json").read_text(encoding="utf-8"))
    for path in options.answers:
        document = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(document, dict) or not isinstance(document.get("campaigns"), dict):
            parser.error(f"{path}: an object with entrant and campaigns was expected.")
        if unknown := sorted(document["campaigns"].keys() - truths.keys()):
            parser.error(f"{path}: the round has no campaign {unknown[0]!r}; it has {', '.join(truths)}.")
        try:
            scores = scored(document, truths)
        except ValueError as error:
            parser.error(f"{path}: {error}")
        print(document.get("entrant", path.stem))
        for key, value in summary(list(scores.values())).items():
            print(f"  {key:<10} {value:.3g}")


if __name__ == "__main__":
    main()
