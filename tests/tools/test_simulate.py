"""The simulator as a whole: nothing hidden changes nothing, and its steps are fine enough."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest

from tests.tools.motions import LAWS, hiding, move, quiet, strong, ticks
from tools.programme import Hold, Run
from tools.simulate import SUBSTEP, Motion
from tools.trial_day import deviated, record
from tools.truth import ROSUB, SMALL, Attitude, Disturbance, Truth


def excitation(truth: Truth) -> list[tuple[float, float]]:
    """Both ways, a stop, and steps that come faster than the vehicle follows."""
    middle, pace = truth.middle, truth.pace or 1.0
    shares = (
        (0.0, 1.0),
        (8.0, -1.3),
        (16.0, 0.0),
        (22.0, 1.2),
        (23.013, -1.1),
        (24.5, 0.7),
        (28.0, 0.0),
        (30.0, 0.5),
        (33.0, 0.0),
    )
    return [(time * pace, share * middle) for time, share in shares]


def excited(truth: Truth, *, substep: int = SUBSTEP) -> Motion:
    return move(truth, *excitation(truth), duration=36.0 * (truth.pace or 1.0), substep=substep)


@functools.cache
def unhidden(*, leaning: bool = False) -> Motion:
    """The small vehicle with nothing hidden; ``leaning``: quiet, in roll and pitch."""
    return excited(replace(quiet(SMALL), attitude=Attitude()) if leaning else SMALL)


@pytest.mark.parametrize(("effect", "form"), LAWS)
def test_null_size_changes_nothing_at_all(effect: str, form: str) -> None:
    (one,) = strong(SMALL, effect, form).hidden
    plain, nulled = unhidden(), excited(replace(SMALL, hidden=(one.nulled(),)))
    assert (plain.heading == nulled.heading).all()
    assert (plain.roll == nulled.roll).all()


@pytest.mark.parametrize(("effect", "form"), LAWS)
def test_what_is_hidden_goes_to_nothing_with_its_size_and_is_seen_when_strong(effect: str, form: str) -> None:
    truth = quiet(SMALL)
    case = strong(truth, effect, form)
    (one,) = case.hidden
    law, size = one.law, one.parameters[one.law.size]
    small = size * 1e3 if np.isinf(law.null) else law.null + 1e-3 * (size - law.null)
    # Torque by pitch needs pitch.
    leaning = replace(truth, attitude=Attitude())
    full = case.of(leaning)
    tiny = replace(leaning, hidden=(replace(one, parameters={**one.parameters, law.size: small}),))
    base = unhidden(leaning=True).heading
    seen, little = (
        float(np.max(np.abs(np.degrees(deviated(excited(truth).heading, truth) - base)))) for truth in (full, tiny)
    )
    assert seen > 0.1  # ten times the heading's noise
    assert little < 0.01 * seen


@pytest.mark.parametrize(("effect", "form"), LAWS)
def test_integration_has_converged(effect: str, form: str) -> None:
    truth = strong(SMALL, effect, form).of(replace(SMALL, disturbance=Disturbance(standard_deviation=0.0)))
    coarse, fine = excited(truth), excited(truth, substep=SUBSTEP // 2)
    # A tenth of the heading's noise; dead zones and reversals have kinks inside steps.
    np.testing.assert_allclose(np.degrees(coarse.heading), np.degrees(fine.heading), rtol=0.0, atol=1e-3)


def test_a_delay_of_no_whole_number_of_samples_shifts_the_motion() -> None:
    levels = excitation(ROSUB)
    now = move(quiet(ROSUB), *levels)
    late = move(
        hiding(quiet(ROSUB), "command_delay", "constant", delay=0.2371), *levels, sample=ticks(20.0, offset=237_100)
    )
    np.testing.assert_allclose(late.heading, now.heading, rtol=0.0, atol=1e-8)


def test_heading_deviation_is_added_to_the_log_alone() -> None:
    psi = np.linspace(-7.0, 7.0, 500)
    for form, wanted in {
        "one_cycle": np.sin(psi + 0.8),
        "two_cycles": np.sin(2.0 * psi + 0.8),
        "mixed": np.sin(psi + 0.8) + 0.5 * np.sin(2.0 * psi - 0.8),
    }.items():
        truth = hiding(quiet(ROSUB), "heading_deviation", form, amplitude=0.05, phase=0.8)
        np.testing.assert_allclose(deviated(psi, truth) - psi, 0.05 * wanted, atol=1e-12)
        run = Run(name="hold", pieces=(Hold(1.55, 60.0),))
        plain, shown = (record(run, t, "csv", 1, 0).heading for t in (quiet(ROSUB), truth))
        true = np.radians(plain)
        seen = (shown - np.degrees(deviated(true, truth)) + 180.0) % 360.0 - 180.0
        np.testing.assert_allclose(seen, 0.0, atol=0.0016)  # both rounded to 0.001 deg
