"""Do formulas take the place of a cause that the catalogue lacks? Effects struck from it, and causes of no catalogue.

Run ``python -m benchmarks.formulas --seeds 1 2 --state benchmarks/records/formulas.jsonl --page docs/discover.md``.
Each effect of yaw is hidden in a calm campaign and struck from the catalogue. tools/beyond.py hides causes that no
catalogue has. A campaign in the state is not repeated; ``--page-only`` writes the section of the page alone.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks.formulas_page import line_of, write_section
from rovid.core.budget import Budget
from rovid.core.errors import RovidError
from rovid.diagnose import objectives
from rovid.diagnose.algorithm import conclude, decide
from rovid.diagnose.cross_validation import cross_validate, held_out_log_likelihood, split_runs
from rovid.diagnose.effect_trial import _gain
from rovid.diagnose.formulas.search import Formula, FormulaSearch, doubt_stand_ins
from rovid.diagnose.objectives import SearchProblem, pose, preload, without_waves
from rovid.diagnose.result import Diagnosis
from rovid.effects import Effect, forms_for
from rovid.estimate.fit_result import FitResult
from rovid.model.model import Model
from rovid.model.simulation import simulate_runs
from rovid.store.study import Study, open_study
from tools import beyond
from tools.cases import all_cases, truth_of
from tools.programme import CAMPAIGN
from tools.trial_day import write_trial_day
from tools.truth import ROSUB, Truth

Record = dict[str, Any]
_RUNS = ("hold_03", "hold_05", "staircase", "multilevel", "sine_40s_b", "coast_02", "fore_only")
_RATE = 5.0  # Hz
VEHICLE = replace(ROSUB, instruments=replace(ROSUB.instruments, rate=_RATE))
NOTHING = "nothing"


def struck_cases() -> dict[str, Truth]:
    """Id of each effect of yaw -> the truth with the effect in its first form, of strong size; and nothing hidden."""
    found = {NOTHING: VEHICLE}
    for case in all_cases(VEHICLE):
        if case.expected_effect and case.name.endswith("strong"):
            found.setdefault(case.expected_effect, truth_of(VEHICLE, (case,)))
    return found


def searched(study: Study) -> tuple[Diagnosis, FormulaSearch]:
    """Diagnosis, and the search for formulas next to it."""
    assert study.runs is not None
    preload()
    parts = split_runs(study.runs.items, study.vehicle, study.runs.cutoff)
    runs = list(study.runs.items if parts is None else parts.items)
    problem = pose(study.runs, runs, study.vehicle, Budget(seconds=3600.0))
    selection = decide(problem)
    diagnosis = conclude(doubt_stand_ins(problem, selection), ())
    return diagnosis, FormulaSearch(problem, selection.model)


def held_out(fitted: FitResult, problem: SearchProblem) -> float:
    """Log-likelihood of trials that were not fitted, in nats."""
    return held_out_log_likelihood(cross_validate(fitted, problem.innovations.pieces))


def reference(problem: SearchProblem, effect: str) -> float:
    """Held-out gain in nats of the struck effect itself, in its best form next to the plain model."""
    base = problem.innovations.base
    forms = [form for form in every_form(problem) if form.id == effect and not form.is_wave]
    return max((_gain(base, form, problem.innovations.pieces).held_out_gain for form in forms), default=0.0)


def every_form(problem: SearchProblem) -> tuple[Effect, ...]:
    """All forms of the catalogue that have one size in all trials."""
    channels = set.intersection(*(set(run.trial.channels) for run in problem.data.runs))
    assert problem.data.vehicle is not None
    return tuple(without_waves(forms_for(problem.data.vehicle, channels)))


def said(diagnosis: Diagnosis) -> Record:
    return {
        "verdict": diagnosis.verdict,
        "established": [
            {
                "effect": finding.effect.key,
                "or": [other.id for other in finding.indistinguishable],
                "evidence": finding.evidence.name.lower(),
                "held_out_nats": round(finding.held_out_gain, 1),
            }
            for finding in diagnosis.findings
        ],
        "suspects": [finding.effect.key for finding in diagnosis.suspects],
    }


def formula_record(formula: Formula) -> Record:
    return {
        "formula": formula.text,
        "signals": list(formula.signals),
        "beside": list(formula.beside),
        "held_out_nats": round(formula.held_out_nats, 1),
        "nearest": formula.nearest,
    }


def judged(folder: Path, struck: str) -> tuple[Record, FormulaSearch, list[Formula]]:
    """Answers on a folder of logs, with the times in s."""

    def remaining(*args: Any, **more: Any) -> tuple[Effect, ...]:
        return tuple(form for form in forms_for(*args, **more) if form.id != struck)

    began = time.process_time()
    with patch.object(objectives, "forms_for", remaining):
        study = open_study([folder])
        diagnosis, search = searched(study)
        diagnosed = time.process_time()
        found = search.run()
    ended = time.process_time()
    base = held_out(search.problem.innovations.base, search.problem)
    record = said(diagnosis) | {
        "causes": list(found.causes),
        "causes_nats": round(held_out(search.model, search.problem) - base, 1) if found.causes else 0.0,
        "formulas": [formula_record(formula) for formula in found.formulas],
        "seconds": [round(diagnosed - began, 1), round(ended - diagnosed, 1)],
    }
    return record, search, list(found.formulas)


def struck_record(effect: str, seed: int) -> Record:
    """One effect hidden and struck from the catalogue, or nothing hidden."""
    truth = struck_cases()[effect]
    with tempfile.TemporaryDirectory() as room:
        folder = Path(room) / "logs"
        runs = [run for run in CAMPAIGN if run.name in _RUNS]
        write_trial_day(folder, seed=1000 * seed + 56, formats="csv", truth=truth, campaign=runs)
        record, search, _ = judged(folder, effect)
    whole = reference(search.problem, effect) if effect != NOTHING else 0.0
    return {"kind": "struck", "hidden": effect, "seed": seed, "reference_nats": round(whole, 1)} | record


def error_of(model: Model, study: Study, calm: dict[str, list[float]]) -> float:
    """Mean square error of the free-running rate against the rate without disturbance, in (rad/s)^2."""
    assert study.runs is not None
    squares = []
    for item in study.runs.items:
        if Path(item.trial.name).stem not in calm:
            continue
        (simulated,) = simulate_runs([item], model, study.vehicle)
        trial = item.trial
        true = np.interp(item.rates.time, trial.time, np.asarray(calm[Path(trial.name).stem])[: len(trial.time)])
        known = np.isfinite(simulated.simulated)
        squares.append(np.square(simulated.simulated - true)[known])
    return float(np.mean(np.concatenate(squares)))


def beyond_record(cause: str, seed: int) -> Record:
    """A cause of no catalogue; the shares are of the mean square error of the rate on runs that were not read."""
    with tempfile.TemporaryDirectory() as room:
        beyond.write(Path(room), cause, seed)
        record, search, formulas = judged(Path(room) / "logs", "")
        # The hours of the campaign count from the first log.
        shutil.copy(Path(room) / "logs" / "run_01.csv", Path(room) / "held_out")
        study = open_study([Path(room) / "held_out"])
        calm = json.loads((Path(room) / "truth.json").read_text(encoding="utf-8"))["calm_rates"]
        plain = error_of(search.problem.innovations.base.model, study, calm)

        def removed(model: Model) -> float:
            return round(1.0 - error_of(model, study, calm) / plain, 4)

        shares = [removed(formula.model) for formula in formulas]
        causes = removed(search.model.model) if record["causes"] else 0.0
    size = float(np.sqrt(np.mean(np.square(np.concatenate([np.asarray(one) for one in calm.values()])))))
    return (
        {"kind": "beyond", "hidden": cause, "seed": seed, "plain_error": round(plain**0.5 / size, 4)}
        | record
        | {"removed_by_formulas": shares, "removed_by_causes": causes}
    )


def jobs(seeds: Sequence[int], only: Sequence[str] | None) -> Iterator[tuple[str, str, int]]:
    """(kind, what is hidden, seed) of each campaign, a seed after the other."""
    for seed in seeds:
        for kind, names in (("beyond", [*beyond.CAUSES]), ("struck", [*struck_cases()])):
            for name in names:
                if only is None or name in only or kind in only:
                    yield kind, name, seed


def read_state(path: Path) -> list[Record]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--only", nargs="+", help="effects or causes, or struck, or beyond")
    parser.add_argument("--state", type=Path, default=Path("formulas.jsonl"), help="a file of JSON lines, added to")
    parser.add_argument("--page", type=Path, help="page whose section is replaced, docs/discover.md for instance")
    parser.add_argument("--page-only", action="store_true", help="diagnose nothing")
    options = parser.parse_args()
    done = {(one["kind"], one["hidden"], one["seed"]) for one in read_state(options.state)}
    for job in () if options.page_only else jobs(options.seeds, options.only):
        if job in done:
            continue
        kind, name, seed = job
        try:
            record = (struck_record if kind == "struck" else beyond_record)(name, seed)
        except RovidError as error:
            record = {"kind": kind, "hidden": name, "seed": seed, "failure": str(error)}
        with options.state.open("a", encoding="utf-8") as file:
            file.write(json.dumps(record) + "\n")
        print(line_of(record), flush=True)
    if options.page:
        write_section(options.page, read_state(options.state))


if __name__ == "__main__":
    main()
