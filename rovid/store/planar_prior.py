"""The prior of the coupled model from [planar.prior] of rovid.toml: values, a file, a hull, the rigid body."""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rovid.core.errors import ConfigError, suggestion
from rovid.core.input_files import SMALLEST, expected_number
from rovid.model.parameter_names import PLANAR_UNITS, RUDDER_UNITS, unit_of
from rovid.planar.hull import Hull
from rovid.planar.model import SNAME
from rovid.planar.prior import PlanarPrior, PriorValue
from rovid.store.load import read_parameters
from rovid.trial.axis import PLANAR
from rovid.trial.config import Config
from rovid.trial.tables import read_table

# Relative standard errors of a value without one, of a sister vehicle, and of a hull's added mass and drag. Decisions:
# published panel codes and experiments agree within 10 to 50 % for hulls with appendages.
_RELATIVE_ERROR, _OF_HULL = 0.3, 0.5
# Total inertia over that of the rigid body, and the relative standard error. Published vehicles have 1.1 to 2.5.
_OF_RIGID, _RIGID_ERROR = 1.66, 0.41
_KEYS = ("file", "scale", "relative_error", "hull", "rigid_body")
_COLUMNS = ("parameter", "value", "standard_error")
# Unit -> exponent of the length scale of geometrically similar vehicles at the same Froude number (speeds grow with the
# root of the length; Newman 1977, chapter 2).
_FROUDE = {
    "kg": 3.0,
    "kg m": 4.0,
    "kg m^2": 5.0,
    "N s/m": 2.5,
    "N m s": 4.5,
    "N s^2/m^2": 2.0,
    "N m s^2": 5.0,
    "m^2/(N s^2)": -2.0,
}
_NUMBER = r"\s*([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)\s*"
_WITH_ERROR = re.compile(rf"{_NUMBER}(?:(?:\+-|\+/-|±){_NUMBER}(%?)\s*)?")


def planar_prior(config: Config) -> PlanarPrior | None:
    """The prior of a rovid.toml; None without one.

    A value of the user takes the place of one from the file, which takes that of a hull, and this that of the rigid
    body.

    Raises
    ------
    ConfigError
        A key or a value is wrong, or a source needs a size of the vehicle that [vehicle] does not have.
    LogError
        The table cannot be read.
    """
    if not config.prior:
        return None
    table = _PriorParser(config, dict(_flat(config.prior)))
    return PlanarPrior({**table.rigid_body(), **table.hull(), **table.file(), **table.stated()})


def _flat(table: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Keys and values with dotted names: `yaw.inertia = 5` without quotes is a table in TOML."""
    for key, value in table.items():
        if isinstance(value, dict) and key not in _KEYS:
            yield from _flat(value, f"{before}{key}.")
        else:
            yield before + key, value


@dataclass(frozen=True)
class _PriorParser:
    """[planar.prior] with the vehicle that it describes."""

    config: Config
    entries: Mapping[str, Any]

    def error(self, key: str, text: str, mend: str = "") -> ConfigError:
        return ConfigError(text, where=f"{self.config.path}: [planar.prior] {key}", mend=mend)

    def number(self, key: str, value: object, *, positive: bool = True) -> float:
        if expected := expected_number(value, positive=positive):
            raise self.error(key, f"is {value!r}; {expected} was expected.")
        assert isinstance(value, int | float)  # noqa: S101 - by expected_number
        return float(value)

    def relative_error(self, usual: float) -> float:
        return self.number("relative_error", self.entries.get("relative_error", usual))

    @property
    def rigid(self) -> dict[str, float | None]:
        """Part of the rigid body in each inertia; its centre of gravity is taken to be the origin."""
        mass, yaw = self.config.vehicle.mass, self.config.vehicle.rigid_body_inertia
        return {"surge.inertia": mass, "sway.inertia": mass, "yaw.inertia": yaw}

    def rigid_body(self) -> dict[str, PriorValue]:
        """Inertias from mass and size, with any usual added mass."""
        wanted, error = self.entries.get("rigid_body", False), self.relative_error(_RIGID_ERROR)
        if not isinstance(wanted, bool):
            raise self.error("rigid_body", f"is {wanted!r}; true or false was expected.")
        if wanted and self.config.vehicle.mass is None:
            raise self.error("rigid_body", "needs the mass of the vehicle.", "Add mass = … to [vehicle].")
        sizes = {name: _OF_RIGID * size for name, size in self.rigid.items() if wanted and size is not None}
        return {name: self.value(name, size, error * size, "the rigid body") for name, size in sizes.items()}

    def hull(self) -> dict[str, PriorValue]:
        """Strip theory and the added masses of an ellipsoid."""
        sizes, vehicle = self.entries.get("hull"), self.config.vehicle
        if sizes is None:
            return {}
        known = ("length", "beam", "draught", "height", "drag_coefficient")
        if not isinstance(sizes, dict) or not set(sizes) <= set(known) or {"draught", "height"} <= set(sizes):
            mend = "Give draught of a hull at the surface, or height of a submerged one."
            raise self.error("hull", f"is {sizes!r}; length, beam, and draught or height were expected.", mend)
        given = {key: self.number(f"hull.{key}", value) for key, value in sizes.items()}
        submerged = "draught" not in given
        depth = given.get("draught", given.get("height", vehicle.height))
        length, beam = given.get("length", vehicle.length), given.get("beam", vehicle.width)
        if length is None or beam is None or depth is None:
            raise self.error("hull", "needs length, beam, and draught or height, here or in [vehicle].")
        found = Hull(
            length=length,
            beam=beam,
            depth=depth,
            submerged=submerged,
            mass=vehicle.mass,
            yaw_inertia=vehicle.rigid_body_inertia,
            drag_coefficient=given.get("drag_coefficient", 1.0),
        )
        error = self.relative_error(_OF_HULL)
        return {name: self.value(name, one, error * one, "strip theory") for name, one in found.parameters().items()}

    def file(self) -> dict[str, PriorValue]:
        """A parameter file of another vehicle, or a table of parameters."""
        if "file" not in self.entries:
            return {}
        path = self.config.path.parent / str(self.entries["file"])
        if path.suffix.lower() != ".toml":
            return self.table_of(path)
        stored = read_parameters(path)
        if stored.axis is not PLANAR:
            raise self.error("file", f"holds the parameters of {stored.axis.name}; planar was expected.")
        scale, error = self.number("scale", self.entries.get("scale", 1.0)), self.relative_error(_RELATIVE_ERROR)
        found: dict[str, PriorValue] = {}
        for name, entry in stored.entries.items():
            own = math.hypot(error * entry.value, entry.standard_error)
            if self.is_known(name) and own > 0.0:
                factor = scale ** _FROUDE[unit_of(name)]
                found[name] = self.value(name, entry.value * factor, own * factor, path.name)
        return found

    def table_of(self, path: Path) -> dict[str, PriorValue]:
        """A table with the columns parameter, value and, if known, standard_error."""
        table = read_table(path)
        found: dict[str, PriorValue] = {}
        errors = table.numbers(_COLUMNS[2], empty_allowed=True) if _COLUMNS[2] in table.header else None
        for at, (name, value) in enumerate(zip(table.text(_COLUMNS[0]), table.numbers(_COLUMNS[1]), strict=True)):
            error = None if errors is None or math.isnan(errors[at]) else float(errors[at])
            found |= self.named(name, float(value), error, path.name)
        return found

    def stated(self) -> dict[str, PriorValue]:
        """Values of the user."""
        found: dict[str, PriorValue] = {}
        for name, value in self.entries.items():
            if name in _KEYS:
                continue
            match = _WITH_ERROR.fullmatch(value if isinstance(value, str) else "")
            if isinstance(value, str) and match is None:
                raise self.error(name, f'is {value!r}; a number or "value +- standard error" was expected.')
            number = self.number(name, float(match[1]) if match else value, positive=False)
            error = float(match[2]) * (0.01 * abs(number) if match[3] else 1.0) if match and match[2] else None
            found |= self.named(name, number, error, "rovid.toml")
        return found

    def named(self, name: str, value: float, error: float | None, source: str) -> dict[str, PriorValue]:
        """The prior of a parameter, or of a hydrodynamic derivative (SNAME 1950) without the rigid body."""
        derivatives = {derivative: parameter for parameter, derivative in SNAME.items()}
        error = self.relative_error(_RELATIVE_ERROR) * abs(value) if error is None else error
        if parameter := derivatives.get(name):
            part = self.rigid.get(parameter, 0.0)
            if part is None:
                raise self.error(name, "needs the rigid body's part.", "Add mass, length and width to [vehicle].")
            name, value = parameter, part - value
        if not self.is_known(name):
            mend = suggestion(name, [*PLANAR_UNITS, *derivatives])
            raise self.error(name, "is no parameter of the coupled model.", mend)
        return {name: self.value(name, value, error, source)}

    def is_known(self, name: str) -> bool:
        """Whether a prior may be given for the parameter."""
        rudders = [one.name for one in self.config.vehicle.thrusters if one.rudder is not None]
        return name in PLANAR_UNITS or name in {f"rudder.{one}.{part}" for one in rudders for part in RUDDER_UNITS}

    def value(self, name: str, value: float, error: float, source: str) -> PriorValue:
        """The prior of a parameter, within the limits of a parameter file."""
        if name != "sway_yaw.inertia" and not value >= (SMALLEST if name.endswith(".inertia") else 0.0):
            raise self.error(name, f"is {value:g}, which is not possible.")
        if not error > 0.0:
            text = f"is {value:g} with the standard error {error:g}; a positive error was expected."
            raise self.error(name, text, 'Write "value +- standard error".')
        return PriorValue(value=value, standard_error=error, source=source)
