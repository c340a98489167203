"""What hangs on a guess: by the unit where it is one factor of all torque, everything where it is not."""

from __future__ import annotations

import pytest

from rovid.trial.assumptions import Assumptions

ARMS = Assumptions(items=("yaw_arm of fore", "yaw_arm of aft"), thrusters=2)
ONE_OF_TWO = Assumptions(items=("yaw_arm of fore",), thrusters=2)
ALONE = Assumptions(items=("yaw_arm of aft",), thrusters=1)
CURVE = Assumptions(items=("yaw_arm of fore", "curve of fore"), thrusters=1)


def test_nothing_guessed_is_nothing_said() -> None:
    none = Assumptions(thrusters=2)
    assert not none
    assert (none.caution, none.refusal, none.effect_caveat("thruster_imbalance")) == ("", "", "")
    assert not none.is_placeholder("N m")


@pytest.mark.parametrize("guess", [ARMS, ALONE])
def test_arms_are_one_factor_of_all_torque(guess: Assumptions) -> None:
    marked = [
        unit
        for unit in ("kg m^2", "kg m²", "N m s/rad", "N m", "N", "s", "1", "rad/s", "m")
        if guess.is_placeholder(unit)
    ]
    assert marked == ["kg m^2", "kg m²", "N m s/rad", "N m", "N"]
    assert guess.ratios_hold


@pytest.mark.parametrize("guess", [ONE_OF_TWO, CURVE])
def test_of_a_wrong_shape_nothing_holds(guess: Assumptions) -> None:
    assert not guess.ratios_hold
    assert guess.is_placeholder("s")
    assert "ratios are placeholders" in guess.caution


def test_the_caution_says_what_is_guessed_and_what_ratios_ask_for() -> None:
    assert ARMS.caution.startswith("Guessed by rovid init, not measured: yaw_arm of fore and aft. ")
    assert "if these arms are equal in size" in ARMS.caution
    assert ALONE.caution.endswith("ratios and times hold.")
    assert CURVE.listing == "yaw_arm and curve of fore"
    assert (
        Assumptions(items=(*ARMS.items, "curve of aft"), thrusters=2).listing
        == "yaw_arm of fore and aft and curve of aft"
    )
    assert (CURVE.curve_clause, ARMS.curve_clause) == (", with a guessed thrust curve,", "")


@pytest.mark.parametrize(
    ("guess", "effect", "blamed"),
    [
        (CURVE, "command_delay", True),
        (ARMS, "thruster_imbalance", True),
        (ARMS, "command_delay", False),
        (ALONE, "thruster_imbalance", False),
    ],
)
def test_a_cause_that_may_be_the_guess_is_blamed_on_it(guess: Assumptions, effect: str, blamed: bool) -> None:
    assert bool(guess.effect_caveat(effect)) is blamed


def test_two_guesses_together_are_each_said_once() -> None:
    assert (ONE_OF_TWO | ARMS).items == ARMS.items
