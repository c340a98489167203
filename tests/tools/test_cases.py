"""The catalogue of cases."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.effects import CATALOGUE
from tests.tools.motions import LAWS, hiding
from tests.tools.test_simulate import excited
from tools.cases import CONTRACT_FORMS, SIZES, all_cases, groups, truth_of
from tools.hidden import DRIVERS, EFFECTS, FORMS, OUTSIDE, Hidden
from tools.truth import ROSUB, SMALL, VEHICLES, Truth


def test_mistakes_in_what_is_hidden_are_refused() -> None:
    with pytest.raises(ValueError, match="not known"):
        Hidden(effect="thruster_lag", form="cubic")
    with pytest.raises(ValueError, match="wanted"):
        Hidden(effect="thruster_lag", form="quadratic", parameters={"time_constant": 1.0})
    with pytest.raises(ValueError, match="thruster is named"):
        Hidden(effect="thruster_imbalance", form="gain", parameters={"gain": 0.9})
    truth = hiding(ROSUB, "bias_torque", "constant", torque=1.0)
    with pytest.raises(ValueError, match="twice"):
        excited(hiding(truth, "bias_torque", "constant", torque=2.0))


def test_the_names_are_the_contracts() -> None:
    assert set(EFFECTS) <= {effect.id for effect in CATALOGUE}
    assert all(len(FORMS[effect]) >= 2 for effect in EFFECTS)
    assert all(set(forms) <= set(FORMS[effect]) for effect, forms in CONTRACT_FORMS.items())
    assert set(DRIVERS) == set(FORMS[OUTSIDE])


@pytest.mark.parametrize("vehicle", VEHICLES, ids=lambda vehicle: vehicle.command_unit)
def test_every_form_is_a_case_at_both_sizes(vehicle: Truth) -> None:
    cases = {case.name: case for case in all_cases(vehicle)}
    wanted = {f"{effect}-{form}-{size}" for effect, form in LAWS for size in SIZES}
    assert set(cases) == {"nothing", *wanted}
    for effect, form in LAWS:
        weak, full = (cases[f"{effect}-{form}-{size}"] for size in SIZES)
        assert weak.expected_effect == full.expected_effect == (None if effect == OUTSIDE else effect)
        law = FORMS[effect][form]
        sizes = [abs(1 / c.hidden[0].parameters[law.size] - 1 / law.null) if np.isinf(law.null)
                 else abs(c.hidden[0].parameters[law.size] - law.null) for c in (weak, full)]  # fmt: skip
        assert 0.0 < sizes[0] < sizes[1]
    assert cases["thruster_lag-first_order-weak"].expected_parameters is not None
    assert cases["thruster_lag-quadratic-weak"].expected_parameters is None


def test_groups_hold_no_near_twins_and_are_drawn_by_their_seed() -> None:
    triples = groups(SMALL, together=3, count=20, seed=4)
    assert triples == groups(SMALL, together=3, count=20, seed=4)
    for group in triples:
        names = {case.expected_effect for case in group}
        assert len(names) == 3
        assert not {"thruster_lag", "command_delay"} <= names
        assert len(truth_of(SMALL, group).hidden) == 3
    excited(truth_of(SMALL, triples[0]))
