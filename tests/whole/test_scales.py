"""Results do not depend on the size of the vehicle: times, torques and commands may have any scale."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from rovid.effects import FORMS
from rovid.effects.base import Scales
from tests.conftest import SAMPLES, Rovid
from tests.scaling import Scaling, write_scaled

HIDDEN = SAMPLES / "rosub_hidden"  # a lag and an asymmetry
PLAIN = SAMPLES / "rosub_tank"
ONE = Scaling()
SCALINGS = [
    Scaling(time=0.1, torque=1e6, command=1e3),
    Scaling(time=10.0, torque=1e-3),
    Scaling(time=0.1),
    Scaling(time=10.0),
    Scaling(torque=1e-3),
    Scaling(torque=1e6),
    Scaling(command=1e3),
]
# Largest relative change of a parameter, and largest change in standard errors. Times in a log have 16 digits.
# The optimiser ends within 0.05 of the largest log-likelihood: 0.3 standard errors at worst, but by the same steps.
RELATIVE, SIGMAS = 1e-4, 0.01

Document = dict[str, Any]


def assert_scaled(found: Mapping[str, Document], wanted: Mapping[str, Document], scaling: Scaling) -> None:
    assert found.keys() == wanted.keys()
    for name, parameter in wanted.items():
        factor, error = scaling.factor(parameter["unit"]), parameter["standard_error"]
        close = max(RELATIVE * abs(parameter["value"]), SIGMAS * error)
        assert found[name]["value"] / factor == pytest.approx(parameter["value"], abs=close, rel=0.0), name
        assert found[name]["standard_error"] / factor == pytest.approx(error, rel=1e-2), name


def checked(document: Document) -> tuple[Any, ...]:
    holds = [log["held_commands"] for log in document["logs"]]
    faults = [(fault["fault"], fault["logs"]) for fault in document["faults"]]
    return document["verdict"], holds, faults, [advice["kind"] for advice in document["advice"]]


@pytest.mark.parametrize("scaling", SCALINGS, ids=str)
@pytest.mark.parametrize("source", [HIDDEN, PLAIN], ids=lambda source: source.name)
@pytest.mark.slow
def test_results_scale_with_the_vehicle(source: Path, scaling: Scaling, tmp_path: Path, rovid: Rovid) -> None:
    logs, scaled = (write_scaled(source, tmp_path / name, size) for name, size in (("one", ONE), ("other", scaling)))
    assert checked(rovid("check", scaled, "--json").document) == checked(rovid("check", logs, "--json").document)
    for command in ("fit-drag", "fit"):
        found, wanted = (rovid(command, folder, "--json").document for folder in (scaled, logs))
        assert_scaled(found["parameters"], wanted["parameters"], scaling)
    found, wanted = (rovid("diagnose", folder, "--json").document for folder in (scaled, logs))
    assert found["verdict"] == wanted["verdict"]
    for kind in ("findings", "suspects"):
        assert [cause["effect"] for cause in found[kind]] == [cause["effect"] for cause in wanted[kind]]
        for cause, same in zip(found[kind], wanted[kind], strict=True):
            assert cause["confidence"] == pytest.approx(same["confidence"], abs=1e-3)
            assert_scaled(cause["parameters"], same["parameters"], scaling)
    assert_scaled(found["base"]["parameters"], wanted["base"]["parameters"], scaling)


def test_units_of_all_parameters_have_a_factor() -> None:
    scaling = Scaling(time=2.0, torque=3.0, command=5.0)
    factors = {
        "N m s^3/rad^3": 24.0,
        "kg m^2": 12.0,
        "command/s": 2.5,
        "rad/s": 0.5,
        "N m/rad": 3.0,
        "1/h": 0.5,
        "1": 1.0,
    }
    assert {unit: scaling.factor(unit) for unit in factors} == factors


def test_scales_of_all_parameters_have_the_dimension_of_their_unit() -> None:
    scaling = Scaling(time=2.0, torque=3.0, command=5.0)
    plain = Scales(command=1.0, torque=1.0, rate=1.0, wash=1.0)
    root, speed = scaling.torque**0.5, 1.0 / scaling.time
    scaled = Scales(
        command=scaling.command,
        torque=scaling.torque,
        rate=1.0 / scaling.time,
        wash=root,
        sqrt_thrust=root,
        surge=speed,
        sway=speed,
        longest=scaling.time,
        day=scaling.time,
        time=scaling.time,
    )
    for effect in FORMS:
        # A time at the rate of 0.3 rad/s is no time that scales.
        for parameter in (one for one in effect.parameters if one.scale != "time_at_reference"):
            factor = scaled.unit_size(parameter) / plain.unit_size(parameter)
            assert factor == pytest.approx(scaling.factor(parameter.unit)), (effect.key, parameter.name)
