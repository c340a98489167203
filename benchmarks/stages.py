"""Where the time of a diagnosis goes: each stage's share, how often it asked the model, and all beside the screening.

A synthetic day with slow thrusters, weak in reverse, is diagnosed twice in one process and on one core: the first time
compiles what was not compiled before, the second is measured. Stages are functions of rovid's, wrapped by name; one
that is not there any more, or is never called, ends this with an error.
"""

from __future__ import annotations

import argparse
import importlib
import inspect
import os
import secrets
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

from rovid.core.threads import CORES_VARIABLE
from rovid.diagnose.result import Diagnosis
from rovid.store import study
from tools.cases import all_cases, truth_of
from tools.trial_day import write_trial_day
from tools.truth import VEHICLES

HIDDEN = ("thruster_lag-first_order-strong", "thrust_asymmetry-gain-strong")
WHOLE, SCREENING, CLIMBS = "diagnosis", "screening", "climbs"
# Where a function is called from, by module and name, and the stage that it is; several may be of one.
STAGES = {
    "rovid.store.study.open_study": "reading",
    "rovid.diagnose.objectives.fit_output_error": "start fit",
    "rovid.diagnose.objectives.cv_pieces": "cutting into pieces",
    "rovid.diagnose.algorithm.select_directly": "search by one-step predictions",
    "rovid.diagnose.objectives.run_wave_test": "waves",
    "rovid.diagnose.stepwise.score_tests": SCREENING,
    "rovid.diagnose.stepwise.shortlist": "shortlist",
    "rovid.diagnose.stepwise.fit_candidates": CLIMBS,
    "rovid.estimate.fit_result.minimize": CLIMBS,
    "rovid.diagnose.algorithm.first_rejection": "validation",
    "rovid.diagnose.algorithm.challenge": "challenge",
    "rovid.diagnose.algorithm.validate": "validation",
    "rovid.diagnose.selection.cross_validate": "cross-validation",
    "rovid.diagnose.wave_test.cross_validate": "cross-validation",
    "rovid.diagnose.algorithm.state": "conclusion",
    "rovid.diagnose.algorithm.build_diagnosis": "conclusion",
}
# What asks the model, and how often by what it is given: once a set of parameters.
PASSES: dict[str, Callable[..., int]] = {
    "rovid.estimate.innovation_likelihood._evaluate_batch": len,
    "rovid.estimate.multi_step.prediction_errors": lambda *_: 1,
}

Function = Callable[..., Any]
# A stage by the stages around it, the outermost first.
Place = tuple[str, ...]


@dataclass
class Stage:
    """Wall-clock time, processor time of all threads, and passes of a stage, inner stages included."""

    seconds: float = 0.0
    processor: float = 0.0
    passes: int = 0

    @contextmanager
    def running(self) -> Iterator[None]:
        """Add the time spent in this context."""
        begun, work_begun = time.perf_counter(), time.process_time()
        try:
            yield
        finally:
            self.seconds += time.perf_counter() - begun
            self.processor += time.process_time() - work_begun


@dataclass
class Profile:
    """Every stage that was entered, by the stages around it.

    Only the main thread enters stages. The work of other threads counts for the stage in which the main thread waits.
    """

    stages: dict[Place, Stage] = field(default_factory=dict)
    _current: Place = ()
    _lock: Any = field(default_factory=threading.Lock)

    @contextmanager
    def entered(self, name: str) -> Iterator[None]:
        """Time spent in the stage ``name``; within itself, or in another thread, it is counted already."""
        around = self._current
        if name in around or threading.current_thread() is not threading.main_thread():
            yield
            return
        self._current = (*around, name)
        try:
            with self.stages.setdefault(self._current, Stage()).running():
                yield
        finally:
            self._current = around

    def timed(self, function: Function, name: str) -> Function:
        """``function`` as the stage ``name``."""

        def wrapped(*arguments: Any, **options: Any) -> Any:
            with self.entered(name):
                return function(*arguments, **options)

        def step_by_step(*arguments: Any, **options: Any) -> Iterator[Any]:
            steps = function(*arguments, **options)
            while True:
                with self.entered(name):
                    step = next(steps, None)
                if step is None:
                    return
                yield step

        return step_by_step if inspect.isgeneratorfunction(function) else wrapped

    def counted(self, function: Function, count: Callable[..., int]) -> Function:
        """``function``, which is as many passes as ``count`` says of what it is asked."""

        def wrapped(*asked: Any) -> Any:
            self._pass(count(*asked))
            return function(*asked)

        return wrapped

    def _pass(self, count: int) -> None:
        """So many passes in the current stage and all around it."""
        with self._lock:
            for end in range(1, len(self._current) + 1):
                self.stages[self._current[:end]].passes += count

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Every stage timed and every pass counted, as long as this lasts."""
        with ExitStack() as stack:
            for where, name in STAGES.items():
                owner, attribute = _owner(where)
                stack.enter_context(patch.object(owner, attribute, self.timed(getattr(owner, attribute), name)))
            for where, count in PASSES.items():
                owner, attribute = _owner(where)
                stack.enter_context(patch.object(owner, attribute, self.counted(getattr(owner, attribute), count)))
            yield

    def total(self, name: str) -> Stage:
        """All that was spent in the stage ``name``, wherever it is."""
        total = Stage()
        for place, stage in self.stages.items():
            if place[-1] == name:
                total.seconds += stage.seconds
                total.processor += stage.processor
                total.passes += stage.passes
        return total

    def ordered(self) -> list[tuple[Place, Stage]]:
        """Stages in order of first entry, outer before inner."""
        order = {place: number for number, place in enumerate(self.stages)}
        ends = {place: [order[place[:end]] for end in range(1, len(place) + 1)] for place in order}
        return sorted(self.stages.items(), key=lambda item: ends[item[0]])

    def require_all(self) -> None:
        """Raise RuntimeError for stages that were never entered."""
        met = {place[-1] for place in self.stages}
        lacking = [f"{where} ({name})" for where, name in STAGES.items() if name not in met]
        if lacking:
            raise RuntimeError(f"never called: {', '.join(lacking)}. Say in STAGES what is called in its place.")


def _owner(where: str) -> tuple[Any, str]:
    """The module or the class in which a function is looked up when it is called, and its name there."""
    module, _, name = where.rpartition(".")
    try:
        owner = importlib.import_module(module)
    except ModuleNotFoundError:
        outer, _, kind = module.rpartition(".")
        owner = getattr(importlib.import_module(outer), kind)
    return owner, name


def write_day(folder: Path, seed: int) -> None:
    cases = tuple(case for case in all_cases(VEHICLES[0]) if case.name in HIDDEN)
    assert len(cases) == len(HIDDEN)
    write_trial_day(folder, seed=seed, formats="csv", truth=truth_of(VEHICLES[0], cases))


def diagnosed(folder: Path) -> Diagnosis:
    """Diagnosis of the logs. The function is looked up at the call, because the profiler replaces it."""
    return study.open_study([folder]).diagnosis()


def table(profile: Profile) -> str:
    """Table with a row for each stage, inner stages below; shares of the total."""
    whole = profile.total(WHOLE)
    named = [("  " * (len(place) - 1) + place[-1], stage) for place, stage in profile.ordered()]
    named += [(f"all {name}", profile.total(name)) for name in (SCREENING, CLIMBS)]
    rows = [f"{'stage':36} {'s':>7} {'share':>7} {'processor s':>12} {'share':>7} {'passes':>7}"]
    for name, stage in named:
        shares = 100 * stage.seconds / whole.seconds, 100 * stage.processor / whole.processor
        wall, work = f"{stage.seconds:7.2f} {shares[0]:5.1f} %", f"{stage.processor:12.2f} {shares[1]:5.1f} %"
        rows.append(f"{name:36} {wall} {work} {stage.passes:7}")
    return "\n".join(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=secrets.randbelow(10**6))
    seed = parser.parse_args().seed
    profile = Profile()
    # What a copy of this process does on another core is not seen from here.
    os.environ[CORES_VARIABLE] = "1"
    with tempfile.TemporaryDirectory() as name:
        write_day(Path(name), seed)
        diagnosed(Path(name))
        with profile.watching(), profile.entered(WHOLE):
            diagnosis = diagnosed(Path(name))
    profile.require_all()
    print(table(profile))
    found = ", ".join(finding.effect.key for finding in diagnosis.findings)
    print(f"{diagnosis.verdict}: {found} (seed {seed})")
    whole, screening = profile.total(WHOLE), profile.total(SCREENING)
    longer, more = whole.seconds / screening.seconds, whole.processor / screening.processor
    print(f"A diagnosis takes {longer:.1f} times the time of its screening, {more:.1f} times the processor's.")


if __name__ == "__main__":
    main()
