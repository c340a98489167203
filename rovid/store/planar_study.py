"""A study of surge, sway and yaw together: the logs of a folder, the coupled model of them, and its prior."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rovid.core.budget import Budget, ProgressCallback
from rovid.core.errors import ConfigError, suggestion
from rovid.core.input_files import SMALLEST, expected_number
from rovid.effects import FORMS, PLANAR_FORMS, Effect, effect_named, in_angles
from rovid.estimate.candidate_runs import RunLimits
from rovid.model.bound_effects import BoundEffect
from rovid.model.parameter_names import PLANAR_UNITS, RUDDER_UNITS, unit_of
from rovid.planar.dataset import PlanarData, planar_data
from rovid.planar.diagnosis import PlanarDiagnosis, diagnose_planar
from rovid.planar.effect_fits import is_of_actuators, planar_candidates
from rovid.planar.experiment import PlanarPlan, plan_planar
from rovid.planar.fit import PlanarFit, fit_all_readings, fit_planar
from rovid.planar.likelihood import PlanarPrior, PriorValue
from rovid.planar.model import BASE_COUNT, SNAME, PlanarModel, RudderModel
from rovid.planar.start_values import planar_rudders, planar_sizes, start_values
from rovid.planar.trial_simulation import PlanarTrialSimulation, simulate_planar_trials
from rovid.readers import read_campaign
from rovid.store.load import read_parameters
from rovid.store.parameter_file import OpenCombination, Parameters, Provenance
from rovid.store.study import Study, study_of
from rovid.trial.axis import PLANAR
from rovid.trial.config import Config, find_config, load_planar_config
from rovid.trial.fault import fault_texts, stopping
from rovid.trial.tables import read_table
from rovid.trial.trial import Campaign
from rovid.trial.vehicle import USUAL_INERTIA_RATIO, Vehicle, hull_parameters

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
            error = None
            if isinstance(value, str):
                match = _WITH_ERROR.fullmatch(value)
                if match is None:
                    raise self.error(name, f'is {value!r}; a number or "value +- standard error" was expected.')
                number = self.number(name, float(match[1]), positive=False)
                if match[2]:
                    error = float(match[2]) * (0.01 * abs(number) if match[3] else 1.0)
            else:
                number = self.number(name, value, positive=False)
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


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarStudy:
    """A campaign of logs with its planar runs."""

    logs: Study  #: The same logs along yaw, with their faults and remarks.
    data: PlanarData

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle, with every actuator that acts on surge, sway or yaw."""
        return self.data.vehicle

    @property
    def provenance(self) -> Provenance:
        """Origin of an estimate from this study."""
        return replace(self.logs.provenance, options="")

    def remarks(self) -> list[str]:
        """Remarks on the logs, including everything that was dropped."""
        return self.logs.remarks()

    def unusual_values(self, stored: Parameters) -> list[str]:
        """A sentence for each value of an effect that is far beyond its bounds for these logs."""
        if not stored.effects:
            return []
        start = min(start_values(self.data, with_current=False), key=lambda one: one.residual)
        return stored.unusual_values(map(planar_effect, stored.effects), planar_sizes(self.data, start).effects)

    def fit(self, effects: Sequence[Effect] = ()) -> PlanarFit:
        """Fit of the coupled model with ``effects``; see `fit_planar`.

        Raises DataError if the logs do not excite the vehicle. Raises ConfigError if an effect needs a thruster or a
        signal that these logs do not have.
        """
        if self.data.actuators.steered:
            effects = tuple(map(in_angles, effects))
        self._require_possible(effects)
        return fit_planar(self.data, effects)

    def _require_possible(self, effects: Sequence[Effect]) -> None:
        known = {form.key for form in (*PLANAR_FORMS, *planar_candidates(self.data))}
        for effect in effects:
            if effect.key not in known:
                text = "needs a thruster or a signal that these logs do not have."
                raise ConfigError(text, where=effect.key, mend="Leave the effect out, or complete rovid.toml.")

    def plan(self, effects: Sequence[Effect], limits: RunLimits, narrow: str = "") -> PlanarPlan:
        """The next run, with `fit`'s model and `plan_planar`'s choice; each may raise what these do."""
        self._require_possible(effects)
        return plan_planar(self.data, fit_all_readings(self.data, effects), limits, narrow)

    def diagnosis(
        self, report: ProgressCallback = lambda _: None, *, force: bool = False, budget: float | None = None
    ) -> PlanarDiagnosis:
        """Errors of the coupled model and their causes.

        Raises DataError if the filter diverges next to the fitted model, so that no candidate can be tested.

        ``report``: Called with progress messages.
        ``force``: Diagnose logs with a fault that no fit survives, too.
        ``budget``: Time in s after which the diagnosis answers with what it has; None: the default of these logs.
        """
        faults = stopping(self.logs.faults)
        if faults and not force:
            return PlanarDiagnosis(verdict="bad_logs", missing=" ".join(fault_texts(faults)))
        seconds = self.logs.default_budget if budget is None else budget
        return diagnose_planar(self.data, report, Budget(seconds))

    def simulate(self, model: PlanarModel) -> list[PlanarTrialSimulation]:
        """Every run simulated freely by ``model``."""
        return simulate_planar_trials(model, self.data)

    def model(self, stored: Parameters) -> PlanarModel:
        """The model with the values of a parameter file. Raises ConfigError if a parameter is missing."""
        return planar_model(stored, planar_rudders(self.data))


def planar_model(stored: Parameters, rudders: Sequence[RudderModel] = ()) -> PlanarModel:
    """The model of a file, with ``rudders`` at their places. Raises ConfigError if a parameter is missing."""
    values = {name: entry.value for name, entry in stored.entries.items()} | dict(stored.assumed)
    effects = stored.with_possible_values(map(planar_effect, stored.effects))
    bound = tuple(BoundEffect(effect, np.zeros(len(effect.parameters))) for effect in effects)
    empty = PlanarModel(base=np.ones(BASE_COUNT), effects=bound, rudders=tuple(_stored(one, values) for one in rudders))
    for name in empty.names:
        if name not in values:
            raise ConfigError(f"holds no {name}.", where=stored.path, mend="Run `rovid fit --axes planar LOGS`.")
    return empty.with_values(np.array([values[name] for name in empty.names]))


def _stored(rudder: RudderModel, values: Mapping[str, float]) -> RudderModel:
    names = {part: f"rudder.{rudder.name}.{part}" for part in RUDDER_UNITS}
    parts: dict[str, Any] = {part: values[name] for part, name in names.items() if name in values}
    parts.setdefault("resistance", None)
    return replace(rudder, **parts, stalls="stall" in parts)


def planar_effect(name: str) -> Effect:
    """An effect of the coupled model, by default in its first form. Raises ConfigError if there is no such effect."""
    for form in PLANAR_FORMS:
        if name in {form.key, form.id}:
            return form
    effect = effect_named(name)
    if not is_of_actuators(effect):
        known = dict.fromkeys(form.id for form in PLANAR_FORMS)
        of_thrusters = dict.fromkeys(form.id for form in FORMS if is_of_actuators(form))
        mend = suggestion(name, [*known, *of_thrusters])
        if effect.id == "sideslip_moment":
            mend = "Leave it out: the base model has the Munk moment, and sway_yaw_damping has N_v."
        raise ConfigError("is not an effect of the coupled model.", where=name, mend=mend)
    return effect


def open_combinations(fit: PlanarFit) -> tuple[OpenCombination, ...]:
    """What the logs do not determine: combinations, and parameters that have no influence on them, by reason."""
    found = [OpenCombination(combination=one.combination, text=one.text) for one in fit.undetermined]
    listed = {name for one in found for name in one.combination}
    for name, reason in fit.estimate.refused.items():
        if name not in listed and name in fit.estimate.names:
            found.append(OpenCombination(combination={name: 1.0}, text=f"{name}: {reason}."))
    return tuple(found)


def with_fit(stored: Parameters, fit: PlanarFit, provenance: Provenance | None = None) -> Parameters:
    """``stored`` with the parameters of ``fit`` in place of all earlier ones."""
    estimate = fit.estimate
    return replace(
        stored.with_estimate(estimate, provenance),
        undetermined=open_combinations(fit),
        missing=fit.missing,
        assumed={name: estimate.value(name) for name in estimate.names if name in estimate.refused},
    )


def open_planar_study(paths: Sequence[Path], report: ProgressCallback = lambda _: None) -> PlanarStudy:
    """Read the logs for surge, sway and yaw together. Raises RovidError if they or rovid.toml cannot be read."""
    config = load_planar_config(find_config(paths))
    return planar_study_of(read_campaign(paths, config, report), config)


def planar_study_of(campaign: Campaign, config: Config) -> PlanarStudy:
    """The study of a ``campaign`` that was read with ``config``; see `open_planar_study`."""
    logs = study_of(campaign, config, planar=True)
    trials = () if logs.runs is None else tuple(run.trial for run in logs.runs.items)
    campaign = replace(campaign, trials=trials)
    placed = frozenset(name for name, signal in config.signals.items() if signal.position is not None)
    data = replace(planar_data(campaign, logs.vehicle), prior=planar_prior(config), placed=placed)
    return PlanarStudy(logs=replace(logs, campaign=campaign), data=data)
