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


def problem(answer: Answer) -> str:
    """What is wrong with an answer; empty if nothing."""
    odds = answer.get("causes", {})
    if unknown := set(odds) - set(LABELS):
        return f"causes has {sorted(unknown)[0]!r}; one of these was expected: {', '.join(LABELS)}."
    if any(not 0.0 <= p <= 1.0 for p in odds.values()) or abs(sum(odds.values()) - 1.0) > 1e-6:
        return f"the probabilities in causes sum to {sum(odds.values()):.6g}; 1 was expected."
    wanted = [answer.get("parameters", {}).get(name, []) for name in PARAMETERS] + list(answer.get("heading_deg", []))
    if any(len(one) != len(LEVELS) or not np.isfinite(one).all() for one in wanted):
        return f"each parameter and heading needs {len(LEVELS)} quantiles, at the levels {LEVELS}."
    return ""


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
        if wrong := problem(answer):
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
        print(document["entrant"])
        for key, value in summary(list(scored(document, truths).values())).items():
            print(f"  {key:<10} {value:.3g}")


if __name__ == "__main__":
    main()
