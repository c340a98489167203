"""Values that a user wrote into a parameter file, far beyond the bounds of the effects' parameters."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rovid.api.records import simulation_record
from rovid.core.errors import ConfigError
from rovid.effects import ANGLE_FORMS, PLANAR_FORMS, Effect, effect_named
from rovid.effects.base import EffectParameter
from rovid.model.parameter_names import base_names
from rovid.planar.model import BASE_NAMES
from rovid.store.parameter_file import Entry, Parameters
from rovid.store.planar_study import open_planar_study, planar_effect, planar_model
from rovid.store.study import Study, open_study
from rovid.trial.axis import PLANAR, YAW
from tests.effects.test_effects import CHANNELS, EVERY, SCALES, numbers
from tests.store.days import RUNS, write_day

CATALOGUE = {effect.key: effect for effect in (*EVERY, *PLANAR_FORMS, *ANGLE_FORMS)}
each = pytest.mark.parametrize("effect", CATALOGUE.values(), ids=CATALOGUE)
BODY = dict(zip(base_names(YAW), (5057.0, 3532.0, 132.0), strict=True))
# At these values simulations were NaN, or ended in a ZeroDivisionError.
UNSTABLE = {
    "entrained_swirl.time_constant": (0.0, 1e-9),
    "entrained_swirl.coupling": (9.0,),
    "tank_seiche.damping": (-5.0, 500.0),
    "tank_seiche.frequency": (1e9,),
    "coulomb_resistance:presliding.angle": (0.0, 1e-9),
    "oscillatory_drag:fading.swept_angle": (0.0, 1e-9),
    "tether_torsion:stiffening.angle": (0.0, 1e-9),
    "sideslip_moment:carried.time_constant": (0.0, -1.0, 1e-9),
    "sideslip_moment:turning.time_constant": (0.0, -1.0, 1e-9),
    "sideslip_moment:estimated.time_constant": (0.0,),
    "drag_curvature.cubic": (-1e9,),
}


def stored(effect: Effect, values: dict[str, float]) -> Parameters:
    """A parameter file with ``effect`` at its first initial values, except for these ``values``."""
    known = BODY | dict(zip(effect.parameter_names, numbers(effect, start=True).tolist(), strict=True)) | values
    entries = {
        name: Entry(value=value, standard_error=0.1, unit="1", method="by hand") for name, value in known.items()
    }
    return Parameters(path=Path("parameters.toml"), entries=entries)


def beyond(parameter: EffectParameter) -> Iterator[float]:
    low, high = parameter.bounds()
    yield from (value for value in (low - 0.01 * abs(low) - 1e-9, 1.01 * high + 1e-9) if math.isfinite(value))


@each
def test_a_value_beyond_its_bounds_is_refused_by_name(effect: Effect) -> None:
    stored(effect, {}).effect_forms()
    for name, parameter in zip(effect.parameter_names, effect.parameters, strict=True):
        assert parameter.bounds()[0] <= parameter.neutral or parameter.low > 0.0
        for value in beyond(parameter):
            found = rf"^parameters\.toml: {re.escape(name)} is {re.escape(f'{value:.6g}')}.*; .* was expected\. .*"
            with pytest.raises(ConfigError, match=f"{found}`rovid fit --effect {effect.key}`"):
                stored(effect, {name: value}).effect_forms()


def test_the_coupled_model_has_the_same_check() -> None:
    model = stored(effect_named("current"), {"current.speed": 1.0})
    assert model.effect_forms() == tuple(model.with_possible_values([planar_effect("current")]))
    thrust = stored(effect_named("thruster_lag"), {"thruster_lag.time_constant": -1.0})
    with pytest.raises(ConfigError, match=r"^parameters\.toml: thruster_lag\.time_constant is -1 s; zero or more"):
        planar_model(thrust)


@each
def test_values_of_a_fit_are_within_bounds(effect: Effect) -> None:
    """At the bounds of a fit, and in their equivalents, nothing is unusual."""
    low, high = (
        np.array([bound * SCALES.unit_size(parameter) for parameter, bound in zip(effect.parameters, own, strict=True)])
        for own in zip(*((parameter.low, parameter.high) for parameter in effect.parameters), strict=True)
    )
    rng = np.random.default_rng(5)
    for share in (0.0, 1.0, *rng.random((20, len(low)))):
        values = low + share * (high - low)
        values = values if effect.canonical is None else effect.canonical(values)
        own = stored(effect, dict(zip(effect.parameter_names, values.tolist(), strict=True)))
        assert not list(own.values_beyond_bounds([effect]))
        assert not list(own.values_beyond_bounds([effect], SCALES))


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    """One log of steps with all channels that a form needs."""
    folder = tmp_path_factory.mktemp("day")
    write_day(folder, RUNS[-1:])
    read = open_study([folder])
    assert read.runs is not None
    (run,) = read.runs.items
    extras = {name: np.resize(values, len(run.trial.time)) for name, values in CHANNELS.items()}
    run = replace(run, trial=replace(run.trial, extras=extras))
    return replace(read, runs=replace(read.runs, items=(run,)))


@pytest.mark.parametrize("name", UNSTABLE)
def test_no_simulation_is_without_numbers(name: str, study: Study) -> None:
    for value in UNSTABLE[name]:
        model = stored(effect_named(name.rpartition(".")[0]), {name: value})
        with pytest.raises(
            ConfigError, match=rf"^parameters\.toml: .*{re.escape(name)} is {re.escape(f'{value:.6g}')}"
        ):
            simulation_record(model, study)


@pytest.mark.slow
@pytest.mark.parametrize("effect", [one for one in EVERY if not one.per_thruster], ids=lambda effect: effect.key)
def test_any_value_gives_numbers_or_one_message(effect: Effect, study: Study) -> None:
    if "log_0" in effect.form:
        pytest.skip("of a log that this day does not have")
    usual = numbers(effect, start=True)
    for at, name in enumerate(effect.parameter_names):
        for value in (0.0, 1e-9, 1e9, -1e9, *(usual[at] * factor for factor in (1e-3, 30.0, 1e3, 1e6, -1.0, -1e3))):
            try:
                result = str(simulation_record(stored(effect, {name: value}), study).r2["yaw_rate"])
            except ConfigError as error:
                result = str(error)
            assert f"{name} is {value:.6g}" in result or math.isfinite(float(result))


def test_a_value_that_is_only_unusual_is_a_note(study: Study) -> None:
    """A thruster above its bench curve, and a lag of an hour; at the scales of other logs they may be usual."""
    values = {"thruster_imbalance:fore.gain": 1.1, "thruster_lag.time_constant": 3600.0}
    forms = ("thruster_imbalance:fore", "thruster_lag")
    entries = {name: entry for key in forms for name, entry in stored(effect_named(key), values).entries.items()}
    model = Parameters(path=Path("parameters.toml"), entries=entries)
    gain, lag = study.unusual_values(model)
    assert gain == "thruster_imbalance:fore.gain is 1.1; -1.5 to 1 is usual for these logs."
    assert re.fullmatch(r"thruster_lag\.time_constant is 3600 s; 0 to \d+ is usual for these logs\.", lag)
    assert simulation_record(model, study).r2


COUPLED = dict(zip(BASE_NAMES, (30.0, 60.0, 11.5, 9.5, 5.0, 8.0, 2.0, 30.0, 60.0, 8.0), strict=True))


@pytest.mark.parametrize(
    ("values", "note", "finite"),
    [
        ({"current.speed": 0.08, "current.direction": 2.5}, "", True),
        ({"current.speed": 50.0, "current.direction": 2.5}, "current.speed is 50 m/s; -", False),
        ({"thruster_lag.time_constant": 900.0}, "thruster_lag.time_constant is 900 s; 0 to ", True),
        ({"surge.quadratic_drag": -1e9}, "", False),
    ],
)
def test_the_coupled_model_has_notes_and_no_simulation_without_numbers(
    values: dict[str, float], note: str, finite: bool
) -> None:
    coupled = open_planar_study([Path("sample_logs/planar_rov")])
    entries = {
        name: Entry(value=value, standard_error=0.1, unit="1", method="by hand")
        for name, value in (COUPLED | values).items()
    }
    model = Parameters(path=Path("p.toml"), entries=entries, axis=PLANAR)
    notes = coupled.unusual_values(model)
    assert [one[: len(note)] for one in notes] == ([note] if note else [])
    if finite:
        assert np.isfinite(list(simulation_record(model, coupled).r2.values())).all()
        return
    with pytest.raises(ConfigError, match=rf"^p\.toml: gives no finite simulation of run_01\.csv.*{re.escape(note)}"):
        simulation_record(model, coupled)
