"""The prior of the coupled model from [planar.prior] of rovid.toml: values, a file, a hull, the rigid body."""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from rovid.core.errors import ConfigError, suggestion
from rovid.core.input_files import SMALLEST, expected_number
from rovid.model.parameter_names import PLANAR_UNITS, RUDDER_UNITS, unit_of
from rovid.planar.model import SNAME
from rovid.planar.prior import PlanarPrior, PriorValue
from rovid.store.load import read_parameters
from rovid.trial.axis import PLANAR
from rovid.trial.config import Config
from rovid.trial.hull import hull_parameters
from rovid.trial.tables import read_table
from rovid.trial.vehicle import USUAL_INERTIA_RATIO

# Relative standard errors of a value without one and of a sister vehicle, and of a hull's added mass and drag.
# Decisions.
_RELATIVE_ERROR, _OF_HULL = 0.3, 0.5
# Relative standard error of the usual inertia over that of the rigid body: half of the published range, in logarithms.
_RIGID_ERROR = 0.41
_KEYS = ("file", "scale", "relative_error", "hull", "rigid_body")
_HULL_KEYS = {"length", "beam", "draught", "height", "drag_coefficient"}
_COLUMNS = ("parameter", "value", "standard_error")
# Unit -> exponent of the length scale of similar vehicles at the same Froude number: speeds grow with the root of the
# length (Newman 1977, chapter 2).
_FROUDE = {"kg": 3.0, "kg m": 4.0, "kg m^2": 5.0, "N s/m": 2.5, "N m s": 4.5, "N s^2/m^2": 2.0, "N m s^2": 5.0}
_FROUDE["m^2/(N s^2)"] = -2.0
_DERIVATIVES = {derivative: parameter for parameter, derivative in SNAME.items()}
_NUMBER = r"\s*([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)\s*"
_WITH_ERROR = re.compile(rf"{_NUMBER}(?:(?:\+-|\+/-|±){_NUMBER}(%?)\s*)?")


def planar_prior(config: Config) -> PlanarPrior | None:
    """The prior of a rovid.toml; None without one. A later source replaces an earlier one.

    Raises
    ------
    ConfigError
        A key or a value is wrong, or a source needs a size of the vehicle that [vehicle] does not have.
    LogError
        The table cannot be read.
    """
    if not config.prior:
        return None
    parser = _PriorParser(config, dict(_flat(config.prior)))
    return PlanarPrior({**parser.rigid_body(), **parser.hull(), **parser.file(), **parser.stated()})


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

    def number(self, key: str, value: Any, *, positive: bool = True) -> float:
        if expected := expected_number(value, positive=positive):
            raise self.error(key, f"is {value!r}; {expected} was expected.")
        return float(value)

    def relative_error(self, usual: float = _RELATIVE_ERROR) -> float:
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
        sizes = {name: USUAL_INERTIA_RATIO * size for name, size in self.rigid.items() if wanted and size is not None}
        return {name: self.value(name, size, error * size, "the rigid body") for name, size in sizes.items()}

    def hull(self) -> dict[str, PriorValue]:
        """Strip theory and the added masses of an ellipsoid."""
        sizes, vehicle = self.entries.get("hull"), self.config.vehicle
        if sizes is None:
            return {}
        if not isinstance(sizes, dict) or not _HULL_KEYS.issuperset(sizes) or {"draught", "height"} <= set(sizes):
            mend = "Give draught of a hull at the surface, or height of a submerged one."
            raise self.error("hull", f"is {sizes!r}; length, beam, and draught or height were expected.", mend)
        known = {"length": vehicle.length, "beam": vehicle.width, "height": vehicle.height, **sizes}
        depth = "draught" if "draught" in sizes else "height"
        if any(known[key] is None for key in ("length", "beam", depth)):
            raise self.error("hull", "needs length, beam, and draught or height, here or in [vehicle].")
        length, beam, deep = (self.number(f"hull.{key}", known[key]) for key in ("length", "beam", depth))
        coefficient = self.number("hull.drag_coefficient", sizes.get("drag_coefficient", 1.0))
        rigid, error = (vehicle.mass, vehicle.rigid_body_inertia), self.relative_error(_OF_HULL)
        found = hull_parameters(length, beam, deep, coefficient, *rigid, submerged=depth == "height")
        return {name: self.value(name, one, error * one, "strip theory") for name, one in found.items()}

    def file(self) -> dict[str, PriorValue]:
        """A parameter file of another vehicle, or a table with the columns parameter, value and standard_error."""
        if "file" not in self.entries:
            return {}
        path, found = self.config.path.parent / str(self.entries["file"]), dict[str, PriorValue]()
        if path.suffix.lower() != ".toml":
            table = read_table(path)
            names, values = table.text(_COLUMNS[0]), table.numbers(_COLUMNS[1]).tolist()
            errors = [math.nan] * len(names)
            if _COLUMNS[2] in table.header:
                errors = table.numbers(_COLUMNS[2], empty_allowed=True).tolist()
            for name, value, error in zip(names, values, errors, strict=True):
                found |= self.named(name, value, None if math.isnan(error) else error, path.name)
            return found
        stored = read_parameters(path)
        if stored.axis is not PLANAR:
            raise self.error("file", f"holds the parameters of {stored.axis.name}; planar was expected.")
        scale = self.number("scale", self.entries.get("scale", 1.0))
        for name, entry in stored.entries.items():
            own = math.hypot(self.relative_error() * entry.value, entry.standard_error)
            if self.is_known(name) and own > 0.0:
                factor = scale ** _FROUDE[unit_of(name)]
                found[name] = self.value(name, entry.value * factor, own * factor, path.name)
        return found

    def stated(self) -> dict[str, PriorValue]:
        """Values of the user."""
        found: dict[str, PriorValue] = {}
        for name in [key for key in self.entries if key not in _KEYS]:
            value = self.entries[name]
            match = _WITH_ERROR.fullmatch(value) if isinstance(value, str) else None
            if isinstance(value, str) and match is None:
                raise self.error(name, f'is {value!r}; a number or "value +- standard error" was expected.')
            number = self.number(name, float(match[1]) if match else value, positive=False)
            error = float(match[2]) * (0.01 * abs(number) if match[3] else 1.0) if match and match[2] else None
            found |= self.named(name, number, error, "rovid.toml")
        return found

    def named(self, name: str, value: float, error: float | None, source: str) -> dict[str, PriorValue]:
        """The prior of a parameter, or of a hydrodynamic derivative (SNAME 1950) without the rigid body."""
        error = self.relative_error() * abs(value) if error is None else error
        if parameter := _DERIVATIVES.get(name):
            part = self.rigid.get(parameter, 0.0)
            if part is None:
                raise self.error(name, "needs the rigid body's part.", "Add mass, length and width to [vehicle].")
            name, value = parameter, part - value
        if not self.is_known(name):
            mend = suggestion(name, [*PLANAR_UNITS, *_DERIVATIVES])
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
