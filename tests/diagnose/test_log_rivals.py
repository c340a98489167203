"""Rivals of the causes: the clock, a foreign log, and the coupled model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rovid.core.budget import Budget
from rovid.diagnose import foreign_logs, log_rivals
from rovid.diagnose.evidence import Evidence
from rovid.diagnose.foreign_logs import diagnose_majority, few_logs
from rovid.diagnose.log_rivals import _diagnose, _warnings, _without_offset, coupled_causes, coupled_sentence
from rovid.diagnose.result import Diagnosis, Finding, OtherCause, discriminating_experiment
from rovid.effects import bias_torque, command_delay, effect_named, supply_sag, thruster_imbalance, thruster_lag
from rovid.effects.clock_offset import CLOCKS_APART, mean_shifted
from rovid.estimate.estimate import Estimate
from rovid.trial.preprocessing import PreparedRuns, shift_commands
from rovid.trial.trial import Trial
from tests.diagnose.findings import finding
from tests.faults.days import VEHICLES, day, scaled
from tests.synthetic import VEHICLE, clock, trial


def test_commands_move_against_the_motion() -> None:
    time = clock(60.0)
    command = np.sign(np.random.default_rng(1).normal(size=61))[time.astype(int)]
    moved = shift_commands(trial(time, command, np.sin(0.3 * time)), 0.5)
    # The common time begins at 0.5 s, where the first command begins now.
    np.testing.assert_allclose(moved.position[moved.measured], np.sin(0.3 * (moved.time[moved.measured] + 0.5)))
    np.testing.assert_array_equal(moved.commands[:, 0], np.interp(moved.time + 0.01, time, command).round())
    assert abs(moved.duration - 59.5) < 1e-9


def test_a_held_value_is_moved_by_its_delay() -> None:
    time, values = np.arange(0.0, 10.0, 0.5), np.zeros(20)
    values[8:] = 2.0  # from 4 s on
    early, late = mean_shifted(time, values, -1.0), mean_shifted(time, values, 0.75)
    np.testing.assert_allclose(early, np.where(time >= 3.0, 2.0, 0.0))
    np.testing.assert_allclose(late[8:11], [0.0, 1.0, 2.0])


@pytest.mark.parametrize(
    ("form", "delay", "separate", "kept"),
    [(0, 0.3, True, True), (0, 0.8, True, False), (0, 0.8, False, True), (2, 0.8, True, True)],
)
def test_a_long_delay_between_topics_may_be_an_offset(form: int, delay: float, separate: bool, kept: bool) -> None:
    """A delay at reversals only is no offset."""
    runs = [replace(run, trial=replace(run.trial, separate_clocks=separate)) for run in day("small", 0)]
    found = Diagnosis(verdict="found", findings=(finding(command_delay.FORMS[form], [delay]),))
    result = _without_offset(found, runs)
    assert bool(result.findings) == kept
    either = separate and form == 0
    assert [fault.fault for fault in result.faults] == ["clocks_apart"] * either
    # A shorter one is as likely to be the drive's, and the corrected model is the same.
    (cause,) = result.findings or result.suspects
    assert (CLOCKS_APART in cause.indistinguishable) == either
    assert cause.evidence is not Evidence.CONFIRMED or not either
    tried = OtherCause(effect=CLOCKS_APART, bic_gain=1.0)
    decides = discriminating_experiment(replace(cause, alternatives=(tried,)))
    # No command distinguishes an offset from a delay.
    assert (decides is not None and "one clock" in decides["run"]) == either
    assert result.verdict == ("found" if kept else "suspected")


@pytest.mark.parametrize("separate", [True, False])
def test_a_lag_that_a_delay_replaces_may_be_an_offset_between_topics(*, separate: bool) -> None:
    runs = [replace(run, trial=replace(run.trial, separate_clocks=separate)) for run in day("small", 0)]
    lag = replace(finding(thruster_lag.FORMS[0], [0.3]), indistinguishable=(command_delay.FORMS[0],))
    (cause,) = _without_offset(Diagnosis(verdict="found", findings=(lag,)), runs).findings
    assert (CLOCKS_APART in cause.indistinguishable) == separate


@pytest.mark.parametrize(("effect", "gyro", "warned"), [(0, False, True), (0, True, False), (1, False, False)])
def test_a_lag_may_be_the_sensor_s_where_no_rate_is_logged(effect: int, gyro: bool, warned: bool) -> None:
    cause = [finding(command_delay.FORMS[0], [0.3]), finding(bias_torque.FORMS[0], [0.3])][effect]
    runs = [replace(run, trial=replace(run.trial, rate=np.zeros(len(run.trial.time)))) for run in day("small", 0)]
    warnings = [*_warnings(runs if gyro else day("small", 0), [cause])]
    assert ["navigation filter" in text for text in warnings] == [True] * warned


@pytest.mark.parametrize("clocks_agree", [True, False])
def test_a_delay_between_kept_clocks_is_a_cause(clocks_agree: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = tuple(replace(run, trial=replace(run.trial, separate_clocks=True)) for run in day("small", 0)[:2])
    found = Diagnosis(verdict="found", findings=(finding(command_delay.FORMS[0], [0.8]),))
    monkeypatch.setattr(log_rivals, "diagnose_majority", lambda *_: found)
    prepared = PreparedRuns(items=runs, cutoff=1.0, chosen=True, remarks=(), clocks_agree=clocks_agree)
    assert bool(_diagnose(prepared, VEHICLE, lambda _: None, Budget()).findings) == clocks_agree


@pytest.mark.parametrize(("delay", "kept"), [(0.2, False), (0.41, False), (0.6, True)])
def test_stamps_that_are_late_by_chance_are_no_delay(delay: float, kept: bool) -> None:
    """A logger that reads the commands for its rows alone stamps them late, by up to an interval."""
    found = Diagnosis(verdict="found", findings=(finding(command_delay.FORMS[1], [delay, 1.0]),))
    result = _without_offset(found, day("small", 0), finding(CLOCKS_APART, [0.4]), "The commands were moved by it.")
    assert bool(result.findings) == kept
    assert result.verdict == ("found" if kept else "nothing_found")
    (fault,) = result.faults
    assert fault.fault == "clocks_apart"
    assert ("scatters by" in fault.text) != kept


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize(("delay", "moved"), [(0.2, True), (0.41, False), (0.6, False)])
def test_an_offset_that_a_delay_takes_back_moves_no_commands(
    *, first: bool, delay: float, moved: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Offset and delay of one size smooth the commands: the stamps are right. The delay may follow the move."""
    offset, late = finding(CLOCKS_APART, [0.4]), finding(command_delay.FORMS[1], [delay, 1.0])
    answers = [Diagnosis(verdict="found", findings=(offset, late)), Diagnosis(verdict="found", findings=(late,))]
    if not first:
        answers[0] = Diagnosis(verdict="found", findings=(offset,))

    def answer(prepared: PreparedRuns, *_: object) -> Diagnosis:
        return Diagnosis(verdict="nothing_found") if prepared.clocks_agree else answers.pop(0)

    monkeypatch.setattr(log_rivals, "diagnose_majority", answer)
    prepared = PreparedRuns(items=tuple(day("small", 0)), cutoff=1.0, chosen=True, remarks=())
    result = _diagnose(prepared, VEHICLE, lambda _: None, Budget())
    assert (result.verdict, result.findings) == ("nothing_found", ())
    assert [fault.fault for fault in result.faults] == (["clocks_apart"] if moved else [])


@pytest.mark.parametrize("established", [True, False])
def test_an_offset_that_was_not_corrected_leaves_the_error_unexplained(*, established: bool) -> None:
    offset = finding(CLOCKS_APART, [0.4])
    diagnosis = Diagnosis(verdict="suspected", suspects=(offset,))
    if established:
        diagnosis = Diagnosis(verdict="found", findings=(offset,))
    result = _without_offset(diagnosis, day("small", 0))
    assert (result.verdict, result.findings, result.suspects) == ("unexplained", (), ())
    (fault,) = result.faults
    assert fault.fault == "clocks_apart"
    # Longer than the interval between two rows.
    assert "late by more than a row" in fault.text
    assert fault.text.endswith("the commands were not moved.")


SAG = supply_sag.EFFECT
DAY = day("small", 0)
NAMES = tuple(run.trial.name for run in DAY)


@pytest.mark.parametrize("module", [supply_sag, bias_torque])
@pytest.mark.parametrize("logs", [(2,), (0, 5), (4, 5)])
def test_one_or_two_logs_with_a_size_of_their_own_are_named(module: object, logs: tuple[int, ...]) -> None:
    assert module in (supply_sag, bias_torque)
    names = NAMES[:6]
    sizes = np.full(6, 1.0)
    sizes[list(logs)] = 0.6
    sizes += 1.0 - sizes.mean()
    effect = supply_sag.for_trials(names) if module is supply_sag else bias_torque.for_trials(names)
    assert few_logs(finding(effect, sizes.tolist()), DAY[:6]) == tuple(names[at] for at in logs)


def test_sizes_that_vary_over_all_logs_are_a_cause() -> None:
    effect = supply_sag.for_trials(NAMES[:6])
    assert few_logs(finding(effect, [0.8, 0.88, 0.96, 1.04, 1.12, 1.2]), DAY[:6]) == ()
    assert few_logs(finding(supply_sag.for_trials(NAMES[1:2]), [0.8]), DAY[:6]) == NAMES[1:2]
    assert few_logs(finding(supply_sag.FORMS[0], [0.1, 0.1]), DAY[:6]) == ()


@pytest.mark.parametrize(
    ("instants", "logs"),
    [
        ((2500, 3500), (3,)),
        ((2500, 4500), (3, 4)),
        ((4500,), (5,)),
        ((2500, 3007), (3,)),
        ((2500, 5500), ()),
        ((10,), ()),
    ],
)
def test_a_change_in_one_or_two_logs_alone_may_be_another_vehicle(
    instants: tuple[int, ...], logs: tuple[int, ...]
) -> None:
    """The logs begin 1000 s after one another, and last 14.6 s."""
    suffix = thruster_imbalance.BETWEEN if len(instants) > 1 else thruster_imbalance.FROM_INSTANT
    effect = thruster_imbalance.for_thruster(f"bow{suffix}")
    found = finding(effect, [0.2, *(instant / 3600.0 for instant in instants)])
    assert few_logs(found, DAY[:6]) == tuple(NAMES[at] for at in logs)


def test_sizes_without_a_law_are_possible_at_most() -> None:
    without_law, by_load = (
        finding(supply_sag.for_trials(NAMES[:6]), [0.8, 0.9, 1.2, 1.0, 1.1, 1.0]),
        finding(SAG, [0.2, 1.0]),
    )
    strong = [
        replace(one, probability=0.97, held_out_gain=200.0, standard_errors=20.0) for one in (without_law, by_load)
    ]
    assert [one.evidence for one in strong] == ["possible", "confirmed"]


@pytest.mark.parametrize(("seconds", "place"), [(3.0, "3.0 s after its start"), (-10.0, "the end of")])
def test_a_loss_of_thrust_is_placed_in_its_log(seconds: float, place: str) -> None:
    runs = [replace(one, trial=replace(one.trial, campaign_time=1e4 * k)) for k, one in enumerate(day("small", 0))]
    effect = effect_named("thruster_imbalance:a from an instant")
    (text,) = _warnings(runs, [finding(effect, [0.6, (2e4 + seconds) / 3600.0]), finding(SAG, [0.2, 1.0])])
    assert place in text
    assert NAMES[2 if seconds > 0.0 else 1] in text
    assert "thrust of a is 0.6" in text


@pytest.mark.parametrize("found_by_others", [False, True])
def test_what_the_other_logs_do_not_show_is_not_established(
    found_by_others: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = PreparedRuns(items=tuple(day("small", 0)), cutoff=1.0, chosen=True, remarks=())
    cause = finding(supply_sag.for_trials(NAMES[1:2]), [0.8])
    every = Diagnosis(verdict="found", findings=(cause,))
    others = Diagnosis(verdict="nothing_found")
    if found_by_others:
        others = replace(every, findings=(finding(supply_sag.for_trials(NAMES[2:3]), [0.8]),))

    def diagnosed(prepared: PreparedRuns, *_: object) -> Diagnosis:
        return every if len(prepared.items) == len(NAMES) else others

    monkeypatch.setattr(foreign_logs, "diagnose", diagnosed)
    result = diagnose_majority(runs, VEHICLE, lambda _: None)
    if found_by_others:
        assert result is every
        return
    (suspect,), (fault,) = result.suspects, result.faults
    assert not result.findings
    assert (result.verdict, suspect.effect, suspect.probability) == ("suspected", cause.effect, 0.5 * 0.99)
    assert (fault.fault, fault.logs, fault.remedy) == ("foreign_log", NAMES[1:2], "set_aside")
    assert f"{NAMES[1]} does not belong to the other logs" in fault.text


def test_of_two_payloads_the_logs_of_one_are_diagnosed(monkeypatch: pytest.MonkeyPatch) -> None:
    """A thrust for each trial stands for a larger inertia of half of the trials."""
    heavy = dict.fromkeys(NAMES[::2], scaled(VEHICLES["small"][0], 1.3, 1.0))
    runs = PreparedRuns(items=tuple(day("small", 0, heavy, disturbance=0.005)), cutoff=1.0, chosen=True, remarks=())
    cause = finding(supply_sag.for_trials(NAMES), [1.1, 0.9] * 5)
    every, one = Diagnosis(verdict="found", findings=(cause,)), Diagnosis(verdict="nothing_found")

    def diagnosed(prepared: PreparedRuns, *_: object) -> Diagnosis:
        return every if prepared is runs else one

    monkeypatch.setattr(foreign_logs, "diagnose", diagnosed)
    result = diagnose_majority(runs, VEHICLE, lambda _: None)
    (suspect,) = result.suspects
    assert (result.verdict, result.findings, result.faults) == ("suspected", (), ())
    assert (suspect.effect, suspect.probability) == (cause.effect, 0.5 * 0.99)
    assert "one payload alone" in result.warnings[0]


@pytest.mark.parametrize("shown", [False, True])
def test_two_payloads_that_are_only_likely_are_a_rival(*, shown: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cause that the logs of one payload do not show is none, and neither is one of a single log of these."""
    runs = PreparedRuns(items=tuple(day("small", 0)), cutoff=1.0, chosen=True, remarks=())
    every = Diagnosis(verdict="found", findings=(finding(SAG, [0.2, 1.0]),))
    single = Diagnosis(verdict="found", findings=(finding(bias_torque.for_trials(NAMES[6:7]), [0.3]),))

    def diagnosed(prepared: PreparedRuns, *_: object) -> Diagnosis:
        return every if shown or prepared is runs else single

    monkeypatch.setattr(foreign_logs, "diagnose", diagnosed)
    monkeypatch.setattr(foreign_logs, "minority_payload", lambda _, __, less=0.0: NAMES[:4] if less else ())
    result = diagnose_majority(runs, VEHICLE, lambda _: None)
    if shown:
        assert result is every
        return
    assert (result.verdict, result.findings) == ("suspected", ())
    assert {suspect.effect.id for suspect in result.suspects} == {"supply_sag", "bias_torque"}
    assert [(fault.logs, fault.remedy) for fault in result.faults] == [(NAMES[:4], "set_aside"), (NAMES[6:7], "none")]


def found(*names: str) -> Diagnosis:
    estimate = Estimate(names=(), values=np.zeros(0), covariance=np.zeros((0, 0)), method="", samples=0)
    findings = tuple(
        Finding(
            effect=effect_named(name),
            estimate=estimate,
            gain=50.0,
            bic_gain=45.0,
            held_out_gain=40.0,
            standard_errors=9.0,
            probability=0.97,
            alternatives=(),
            indistinguishable=(),
        )
        for name in names
    )
    return Diagnosis(verdict="found", findings=findings)


def with_channels(*channels: str) -> Trial:
    time = np.arange(10.0)
    extras = {name: np.zeros(10) for name in channels}
    return Trial(
        name="run", path=Path("run"), time=time, position=np.zeros(10), commands=np.zeros((10, 1)), extras=extras
    )


@pytest.mark.parametrize(
    ("names", "channels", "coupled"),
    [
        (("sideslip_moment", "thruster_lag"), ("surge_velocity", "sway_velocity"), ("sideslip_moment",)),
        (("sideslip_moment", "wave_torque"), ("surge_velocity", "sway_velocity"), ("sideslip_moment", "wave_torque")),
        (("wave_torque", "thruster_lag"), ("surge_velocity", "sway_velocity"), ()),
        (("sideslip_moment",), (), ()),
    ],
)
def test_motion_along_sway_recommends_the_coupled_model_where_it_is_logged(
    names: tuple[str, ...], channels: tuple[str, ...], coupled: tuple[str, ...]
) -> None:
    diagnosis, trials = found(*names), [with_channels(*channels)]
    assert coupled_causes(diagnosis, trials) == coupled
    assert ("--axes planar" in coupled_sentence(diagnosis, trials)) == bool(coupled)
