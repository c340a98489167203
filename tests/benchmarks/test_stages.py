"""The profile of a diagnosis names functions of rovid's, and counts what is done in them once."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest

from benchmarks.stages import STAGES, Profile
from rovid.estimate import innovation_likelihood
from rovid.store import study


def test_every_stage_is_there_and_let_go_again() -> None:
    before, passes = study.open_study, innovation_likelihood._evaluate_batch  # noqa: SLF001 - what is counted
    with Profile().watching():
        assert study.open_study is not before
        assert innovation_likelihood._evaluate_batch is not passes  # noqa: SLF001 - as above
    assert study.open_study is before
    assert innovation_likelihood._evaluate_batch is passes  # noqa: SLF001 - as above


def test_passes_count_once_in_the_stage_that_waits_for_them() -> None:
    profile = Profile()
    one = profile.counted(lambda x, _drive: [x], lambda *_: 1)
    several = profile.counted(list, len)
    climb = profile.timed(several, "climbs")
    with profile.entered("search"), ThreadPoolExecutor(1) as pool:
        # Within itself, and in another thread, a stage is no other.
        profile.timed(climb, "climbs")([1, 2])
        pool.submit(climb, [3, 4, 5]).result()
    with profile.entered("waves"):
        one(None, 1)
    with profile.entered("search"), profile.entered("screening"):
        pass
    passes = [(place, stage.passes) for place, stage in profile.ordered()]
    assert passes == [(("search",), 5), (("search", "climbs"), 2), (("search", "screening"), 0), (("waves",), 1)]


def test_a_stage_of_steps_is_left_between_them() -> None:
    profile = Profile()

    def steps() -> Iterator[int]:
        one(1)
        yield 1
        one(2)
        yield 2

    one = profile.counted(lambda x: [x], lambda _: 1)
    for _ in profile.timed(steps, "search")():
        one(3)
    assert [(place, stage.passes) for place, stage in profile.ordered()] == [(("search",), 2)]


def test_a_stage_that_was_never_entered_is_said() -> None:
    profile = Profile()
    for name in set(STAGES.values()) - {"waves"}:
        with profile.entered(name):
            pass
    with pytest.raises(RuntimeError, match=r"rovid\.diagnose\.objectives\.run_wave_test \(waves\)"):
        profile.require_all()
