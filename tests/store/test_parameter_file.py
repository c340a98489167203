"""The parameter file: round trip, merged estimates and requirements of a model."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rovid.core.errors import ConfigError
from rovid.estimate.estimate import Estimate
from rovid.planar.model import BASE_COUNT, PlanarModel, RudderModel
from rovid.store.load import read_parameters
from rovid.store.parameter_file import Parameters, Source, absolute_paths
from rovid.store.planar_study import planar_model

NAMES = ("inertia", "quadratic_drag", "linear_drag")
COVARIANCE = np.array([[100.0, -30.0, 2.0], [-30.0, 900.0, -55.0], [2.0, -55.0, 9.0]])


def estimate(
    names: tuple[str, ...] = NAMES, *, scale: float = 1.0, method: str = "m", refused: tuple[str, ...] = ()
) -> Estimate:
    rows = [NAMES.index(name) for name in names]
    return Estimate(
        names=names,
        values=scale * np.array([5057.0, 3532.0, 132.0])[rows],
        covariance=COVARIANCE[np.ix_(rows, rows)],
        method=method,
        samples=7,
        refused=dict.fromkeys(refused, "why"),
    )


def written(folder: Path, **changes: object) -> Parameters:
    stored = replace(
        Parameters(
            path=folder / "parameters.toml",
            vehicle="a ü [b]",
            logs=(folder / "logs",),
            sources=(Source(name="a.csv", sha256="0", samples=7),),
        ).with_estimate(estimate()),
        **changes,  # type: ignore[arg-type]
    )
    stored.write()
    return stored


def test_round_trip(tmp_path: Path) -> None:
    stored = written(tmp_path)
    found = read_parameters(stored.path)
    assert found == replace(stored, covariance=found.covariance)
    assert found.covariance == pytest.approx(dict(stored.covariance))
    assert found.model().inertia == 5057.0  # to the last digit


def test_the_model_has_effects_that_the_logs_leave_open(tmp_path: Path) -> None:
    base = PlanarModel(base=np.arange(1.0, 1.0 + BASE_COUNT), effects=(), rudders=())
    lift = {"sway_yaw_damping:lift.yaw_by_sway": -3.0, "sway_yaw_damping:lift.sway_by_yaw": 2.0}
    assumed = dict(zip(base.names, base.base.tolist(), strict=True)) | lift
    model = planar_model(Parameters(path=tmp_path / "parameters_planar.toml", assumed=assumed))
    assert [(one.effect.key, one.parameters.tolist()) for one in model.effects] == [
        ("sway_yaw_damping:lift", [-3.0, 2.0])
    ]


def test_the_model_has_the_stored_parameters_of_rudders(tmp_path: Path) -> None:
    rudder = RudderModel(name="helm", position=(-1.5, 0.0), resistance=1.0)
    own = {"lift": 20.0, "slipstream": 0.1, "resistance": 0.7, "straightening": 0.6, "asymmetry": 0.2, "stall": 0.4}
    base = PlanarModel(base=np.arange(1.0, 1.0 + BASE_COUNT))
    assumed = dict(zip(base.names, base.base.tolist(), strict=True))
    assumed |= {f"rudder.helm.{part}": value for part, value in own.items()}
    model = planar_model(Parameters(path=tmp_path / "parameters_planar.toml", assumed=assumed), [rudder])
    assert dict(zip(model.rudders[0].parts, model.rudders[0].values, strict=True)) == own
    # Files of earlier versions have the resistance of a force normal to the blade.
    assumed = {name: value for name, value in assumed.items() if name.rpartition(".")[2] not in list(own)[2:]}
    model = planar_model(Parameters(path=tmp_path / "parameters_planar.toml", assumed=assumed), [rudder])
    assert model.rudders[0].parts == ("lift", "slipstream")


def test_separate_fits_have_no_covariance(tmp_path: Path) -> None:
    stored = Parameters(path=tmp_path / "p.toml").with_estimate(estimate(NAMES[1:], method="steady turns"))
    stored = stored.with_estimate(estimate(NAMES[:1], method="orbit"))
    assert set(stored.covariance) == {
        ("inertia", "inertia"),
        ("quadratic_drag", "quadratic_drag"),
        ("quadratic_drag", "linear_drag"),
        ("linear_drag", "linear_drag"),
    }
    assert {entry.method for entry in stored.entries.values()} == {"steady turns", "orbit"}
    drag = stored.independent_drag()
    assert drag is not None
    assert drag.covariance == pytest.approx(COVARIANCE[1:, 1:])


def test_a_new_estimate_replaces_its_parameters_and_their_effects(tmp_path: Path) -> None:
    stored = Parameters(path=tmp_path / "p.toml").with_estimate(estimate())
    stored = stored.with_estimate(estimate(("inertia",), scale=2.0, method="new"))
    assert stored.entries["inertia"].value == 2.0 * 5057.0
    assert stored.entries["quadratic_drag"].method == "m"
    assert ("inertia", "quadratic_drag") not in stored.covariance
    assert stored.covariance["quadratic_drag", "linear_drag"] == -55.0


def test_a_refused_parameter_is_removed_and_counts_as_zero(tmp_path: Path) -> None:
    stored = Parameters(path=tmp_path / "p.toml").with_estimate(estimate())
    stored = stored.with_estimate(estimate(NAMES[1:], refused=("linear_drag",)))
    assert "linear_drag" not in stored.entries
    assert stored.model().linear_drag == 0.0
    stored.write()
    drag = read_parameters(stored.path).independent_drag()
    assert drag is not None
    assert drag.value("linear_drag") == 0.0


def test_drag_fitted_with_the_inertia_is_not_independent(tmp_path: Path) -> None:
    # `rovid fit-inertia` twice has to give the same: the drag of the first fit must not affect the second.
    assert read_parameters(written(tmp_path).path).independent_drag() is None


def test_an_unknown_error_stays_unknown(tmp_path: Path) -> None:
    # The file of `rovid fit-drag` for a table with one row.
    unknown = replace(estimate(("quadratic_drag",)), covariance=np.array([[np.nan]]))
    stored = Parameters(path=tmp_path / "p.toml").with_estimate(estimate(("inertia",))).with_estimate(unknown)
    stored.write()
    found = read_parameters(stored.path)
    assert np.isnan(found.entries["quadratic_drag"].standard_error)
    assert found.covariance["inertia", "inertia"] == 100.0


def test_log_names_that_are_not_text_are_read_as_written(tmp_path: Path) -> None:
    log = tmp_path / os.fsdecode(b"\xff")
    stored = Parameters(path=tmp_path / "p.toml", logs=absolute_paths([log]))
    stored.write()
    assert read_parameters(stored.path).logs == (log,)


@pytest.mark.parametrize(("names", "words"), [(("inertia",), "fit-drag"), (NAMES[1:], "fit-inertia")])
def test_missing_parameters_of_a_model_are_named(names: tuple[str, ...], words: str, tmp_path: Path) -> None:
    stored = Parameters(path=tmp_path / "p.toml").with_estimate(estimate(names))
    with pytest.raises(ConfigError, match=words):
        stored.model()


def test_an_incomplete_effect_is_named(tmp_path: Path) -> None:
    half = replace(estimate(("inertia",)), names=("added_mass_memory.inertia",))
    stored = Parameters(path=tmp_path / "p.toml").with_estimate(estimate()).with_estimate(half)
    with pytest.raises(ConfigError, match=r"holds no added_mass_memory\.time_constant"):
        stored.model()


@pytest.mark.parametrize("name", ["quadratic_drag", "linear_drag"])
def test_an_implausibly_large_drag_is_refused(name: str, tmp_path: Path) -> None:
    """Each simulated second would need millions of steps."""
    stored = written(tmp_path)
    entries = {**stored.entries, name: replace(stored.entries[name], value=2147483647.0)}
    with pytest.raises(ConfigError, match="which is implausible"):
        replace(stored, entries=entries).model()
