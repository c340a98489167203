"""[planar.prior] of rovid.toml: values, tables, a sister vehicle, a hull and the rigid body."""

from pathlib import Path

import pytest

from rovid.core.errors import ConfigError
from rovid.planar.likelihood import PriorValue
from rovid.store.parameter_file import Entry, Parameters
from rovid.store.planar_study import planar_prior
from rovid.store.study import config_files
from rovid.trial.axis import PLANAR
from rovid.trial.config import load_config, load_planar_config
from tests.planar.campaign import PORT_AND_STARBOARD, SIGNALS, write_campaign

VEHICLE = "[vehicle]\nmass = 100.0\nlength = 2.0\nwidth = 1.0\n"


def read(folder: Path, text: str, vehicle: str = VEHICLE) -> dict[str, PriorValue]:
    """The prior of a rovid.toml with this ``text`` in its table."""
    write_campaign(folder, f"{vehicle}{PORT_AND_STARBOARD}", f"{SIGNALS}\n[planar.prior]\n{text}\n", logs=0)
    found = planar_prior(load_planar_config(folder / "rovid.toml"))
    return {} if found is None else dict(found.values)


def numbers(found: dict[str, PriorValue]) -> dict[str, tuple[float, float]]:
    return {name: (one.value, one.standard_error) for name, one in found.items()}


def test_values_of_the_user_have_errors_or_the_usual_one(tmp_path: Path) -> None:
    text = (
        'yaw.inertia = "1.2e3 +- 2e2"\n"sway.inertia" = 200\nsurge.linear_drag = "8±25 %"\nY_vdot = "-50 +- 5"\nN_v = 1'
    )
    with pytest.raises(ConfigError, match="N_v: is no parameter"):
        read(tmp_path, text)
    found = read(tmp_path, text.replace("N_v = 1", "N_rdot = -10").replace('"sway.inertia"', "surge.inertia"))
    # Mass and box of the vehicle: 100 kg, 100 * (4 + 1) / 12 kg m^2. Of a derivative the error is its own.
    assert numbers(found) == {
        "yaw.inertia": (pytest.approx(41.6667 + 10.0, rel=1e-4), pytest.approx(3.0)),
        "surge.linear_drag": (8.0, 2.0),
        "surge.inertia": (200.0, 60.0),
        "sway.inertia": (150.0, 5.0),
    }
    assert {one.source for one in found.values()} == {"rovid.toml"}


def test_a_table_and_a_sister_take_the_place_of_hull_and_rigid_body(tmp_path: Path) -> None:
    (tmp_path / "panel.csv").write_text("parameter,value,standard_error\nY_vdot,-60,6\nN_rdot,-20,\n")
    found = read(tmp_path, 'rigid_body = true\nhull = { draught = 0.4 }\nfile = "panel.csv"\nsurge.inertia = 110')
    assert {name: one.source for name, one in found.items()} == {
        "surge.inertia": "rovid.toml",
        "sway.inertia": "panel.csv",
        "yaw.inertia": "panel.csv",
        "sway.quadratic_drag": "strip theory",
        "yaw.quadratic_drag": "strip theory",
    }
    # Fossen 2011, section 6.4.3: rho Cd T L/2 and rho Cd T L^4/64, half of it as the error.
    assert numbers(found)["sway.quadratic_drag"] == pytest.approx((400.0, 200.0))
    assert numbers(found)["yaw.quadratic_drag"] == pytest.approx((100.0, 50.0))
    assert numbers(found)["sway.inertia"] == (160.0, 6.0)
    assert read(tmp_path, "rigid_body = true")["yaw.inertia"].value == pytest.approx(1.66 * 500.0 / 12.0)


def test_a_sister_is_scaled_by_froude(tmp_path: Path) -> None:
    entries = {
        name: Entry(value=10.0, standard_error=4.0, unit="", method="")
        for name in ("sway.inertia", "yaw.inertia", "yaw.linear_drag", "sway.quadratic_drag", "current.speed")
    }
    covariance = {(name, name): 16.0 for name in entries}
    assumed = {"surge.inertia": 1.0}
    Parameters(
        path=tmp_path / "sister.toml", axis=PLANAR, entries=entries, covariance=covariance, assumed=assumed
    ).write()
    found = read(tmp_path, 'file = "sister.toml"\nscale = 4.0\nrelative_error = 0.3')
    # Length to the powers 3, 5, 4.5 and 2; the error of the sister, and 30 % of the difference, are independent.
    factors = {"sway.inertia": 64.0, "yaw.inertia": 1024.0, "yaw.linear_drag": 512.0, "sway.quadratic_drag": 16.0}
    assert numbers(found) == {name: pytest.approx((10.0 * one, 5.0 * one)) for name, one in factors.items()}
    # No command replaces the file of the prior, so no fit becomes its own prior.
    assert tmp_path / "sister.toml" in config_files([tmp_path])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('yaw.inertia = "5 or 6"', "is '5 or 6'; a number or"),
        ("yaw.inertia = -5", "is -5, which is not possible"),
        ("yaw.linear_drag = 0", "standard error 0; a positive error"),
        ('yaw.inertia = "5 +- 0"', "standard error 0; a positive error"),
        ("N_v = 1", "N_v: is no parameter of the coupled model"),
        ("yaw.inertai = 5", "Nearest: 'yaw.inertia'"),
        ("hull = { lenght = 2 }", "hull: is {'lenght': 2}; length, beam"),
        ("hull = { beam = 1.0 }", "needs length, beam, and draught or height"),
        ('file = "none.toml"', "there is no such parameter file"),
        ("scale = 0\nfile = 'none.toml'", "no such parameter file"),
        ("rigid_body = 1", "true or false was expected"),
    ],
)
def test_a_wrong_prior_is_refused_by_name(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError) as error:
        read(tmp_path, text)
    assert message in str(error.value)


def test_without_a_table_nothing_changes_and_with_one_fits_are_out_of_date(tmp_path: Path) -> None:
    write_campaign(tmp_path, logs=0)
    plain = load_planar_config(tmp_path / "rovid.toml")
    assert planar_prior(plain) is None
    assert "prior" not in plain.fingerprint.signals
    assert read(tmp_path, "yaw.inertia = 5", vehicle="")
    given = load_planar_config(tmp_path / "rovid.toml")
    assert plain.fingerprint.changes(given.fingerprint) == ["prior is new"]
    # A single axis has no prior.
    assert not load_config(tmp_path / "rovid.toml").prior
    (tmp_path / "rovid.toml").write_text(f"{PORT_AND_STARBOARD}{SIGNALS}[planar]\npriors = 1\n")
    with pytest.raises(ConfigError, match="'priors' is not known here"):
        load_planar_config(tmp_path / "rovid.toml")
