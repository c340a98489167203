"""What the user's LOGS hold, logs or tables, and what can be identified from them."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from rovid.core.errors import ConfigError, DataError, nearest
from rovid.core.signatures import PLAN
from rovid.core.toml import read_toml
from rovid.design.candidate_runs import Limits
from rovid.design.expected_information import Belief
from rovid.design.experiment_design import Plan, belief_of, plan, require_drive
from rovid.diagnose.result import Diagnosis, Finding, Side
from rovid.diagnose.tables import Amplitudes, explain
from rovid.effects import Effect, forms_for
from rovid.effects.per_trial import trials_of
from rovid.estimate.estimate import Estimate
from rovid.estimate.inertia import InertiaFit, fit_inertia, unlike_rigid_body
from rovid.estimate.inertia_table import fit_inertia_table
from rovid.estimate.maximum_likelihood import LikelihoodFit, fit_likelihood
from rovid.estimate.steady_drag import DragFit, fit_drag
from rovid.estimate.steady_points import points_from_table, steady_points
from rovid.readers import read_campaign
from rovid.readers.discover import Reading, files_in
from rovid.signals.preprocessing import Runs, channels, prepare
from rovid.store.parameter_file import Origin, Source, absolute, source_of
from rovid.trial.axis import YAW, Axis
from rovid.trial.config import find_config, load_config, vehicle_of_tables
from rovid.trial.config_fingerprint import Settings
from rovid.trial.tables import SINE_COLUMNS, STEADY_COLUMNS, find_table, read_table
from rovid.trial.trial import Campaign, said_once
from rovid.trial.vehicle import Vehicle

# Effects that a clock which is behind looks like.
_LATE = ("command_delay", "thruster_lag")


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """Logs with their runs, or tables of results in their place.

    Attributes
    ----------
    paths
        As the user gave them.
    campaign, runs
        None where there are tables.
    steady, sine
        Tables of steady states and of sine trials; None where there are logs, or no such table.
    settings
        What of rovid.toml the logs were read by.
    """

    paths: tuple[Path, ...]
    vehicle: Vehicle
    campaign: Campaign | None = None
    runs: Runs | None = None
    steady: Path | None = None
    sine: Path | None = None
    settings: Settings = field(default_factory=Settings)

    @property
    def origin(self) -> Origin:
        """What an estimate of this study comes of; every log is read for its digest."""
        return Origin(
            logs=absolute(self.paths),
            vehicle=self.vehicle.name,
            sources=self._sources,
            settings=self.settings,
            options="" if self.runs is None or self.runs.chosen else f"--cutoff={self.runs.cutoff:g}",
        )

    @cached_property
    def _sources(self) -> tuple[Source, ...]:
        trials = () if self.campaign is None else self.campaign.trials
        logs = [source_of(trial.name, trial.path, int(trial.measured.sum())) for trial in trials]
        # Parts of one log were read from the same files.
        beside = {path: f"{path.name} of {trial.whole or trial.name}" for trial in trials for path in trial.beside}
        logs += [source_of(name, path, 0) for path, name in beside.items()]
        tables = [table for table in (self.steady, self.sine) if table is not None]
        return (*logs, *(source_of(table.name, table, len(read_table(table).rows)) for table in dict.fromkeys(tables)))

    def remarks(self) -> list[str]:
        """What was noticed in the logs, so that nothing is dropped silently."""
        if self.campaign is None or self.runs is None:
            return []
        logs = said_once(self.campaign.trials)
        return [*logs, *(remark.text for remark in (*self.campaign.remarks, *self.runs.remarks))]

    def drag(self) -> DragFit:
        """Drag from steady turns.

        Raises
        ------
        DataError
            There are none.
        """
        if self.runs is not None:
            if self.vehicle.axis.rights:
                raise DataError(
                    f"no constant torque keeps {self.vehicle.axis.name} turning: drag is found with the inertia.",
                    mend="Run `rovid fit-inertia`.",
                )
            fit = fit_drag(steady_points(self.runs.items, self.vehicle), self.vehicle.axis)
            directions = {name: self._guessing(each) for name, each in fit.directions.items()}
            return replace(fit, estimate=self._guessing(fit.estimate), directions=directions)
        if self.steady is None:
            raise DataError(f"there is no table of steady states (columns {', '.join(STEADY_COLUMNS)}).")
        return fit_drag(points_from_table(read_table(self.steady)))

    def inertia(self, drag: Estimate | None) -> InertiaFit:
        """Inertia from sine runs and all excited data, with the steady ``drag`` where it is known.

        Raises
        ------
        DataError
            There is nothing to read it from.
        """
        rigid_body = self.vehicle.measured_inertia
        if self.runs is not None:
            fit = fit_inertia(self.runs.items, drag=drag, rigid_body=rigid_body)
            regression = fit.regression and replace(fit.regression, estimate=self._guessing(fit.regression.estimate))
            return replace(fit, estimate=self._guessing(fit.estimate), regression=regression)
        if self.sine is None:
            raise DataError(f"there is no table of sine trials (columns {', '.join(SINE_COLUMNS)}).")
        return fit_inertia_table(read_table(self.sine), drag=drag, rigid_body=rigid_body)

    def require(self, effects: Sequence[Effect]) -> None:
        """Refuse effects that this axis, or these trials, do not know, or on a thruster lacking or with none beside it.

        Raises
        ------
        ConfigError
            There is such an effect; those of this vehicle are offered.
        """
        known = [form.key for form in forms_for(self.vehicle) if form.each_thruster]
        trials = [run.trial.name for run in (self.runs.items if self.runs else ())]
        for effect in effects:
            for name in set(trials_of(effect.form)).difference(trials):
                raise ConfigError(f"there is no trial {name!r} among these. {nearest(name, trials)}", where=effect.key)
            if effect.axes and self.vehicle.axis.name not in effect.axes:
                raise ConfigError(f"is nothing that acts in {self.vehicle.axis.name}.", where=effect.key)
            if effect.each_thruster and effect.key not in known:
                raise ConfigError(
                    f"does not suit the thrusters of this vehicle. {nearest(effect.key, known)}", where=effect.key
                )

    def likelihood(self, effects: tuple[Effect, ...] = (), *, gyro: bool = False) -> LikelihoodFit:
        """All parameters at once by maximum likelihood, those of ``effects`` included; see `fit_likelihood`.

        Raises
        ------
        DataError
            There are no logs, or the vehicle was not excited enough.
        ConfigError
            An effect acts on a thruster or through a signal that is not there.
        """
        if self.runs is None:
            raise DataError("a table holds no time series to fit.", where=self.paths[0], mend="Give logs.")
        self.require(effects)
        logged = channels(self.runs.items)
        for effect in effects:
            _require_channels(effect, logged)
        fit = fit_likelihood(self.runs.items, self.vehicle, effects, gyro=gyro)
        odd = unlike_rigid_body(fit.estimate, self.vehicle.measured_inertia)
        estimate = replace(fit.estimate, warnings=(*fit.estimate.warnings, *odd))
        return replace(fit, estimate=self._guessing(estimate))

    def _guessing(self, estimate: Estimate) -> Estimate:
        """``estimate``, which knows what of the vehicle is a guess, and says so in what it warns of."""
        guess = self.vehicle.guess
        return replace(estimate, guess=guess, warnings=tuple(map(guess.marked_in, estimate.warnings)))

    def plan(
        self,
        effects: tuple[Effect, ...],
        between: tuple[Effect, ...],
        limits: Limits,
        narrow: str = "",
    ) -> Plan:
        """The run to make next: to tell two causes apart, each beside ``effects``, or to make a parameter surer.

        Raises
        ------
        DataError
            There are no logs, or no run stays within the limits.
        ConfigError
            An effect or a parameter is not there.
        """
        if self.campaign is None:
            raise DataError(
                "a table does not say how fast the vehicle answers.", where=self.paths[0], mend="Give logs."
            )
        require_drive(self.vehicle)
        fits = self._beliefs(effects, between)
        if narrow and narrow not in fits[0].model.names:
            raise ConfigError(f"is {narrow!r}. {nearest(narrow, fits[0].model.names)}", where="--narrow")
        return plan(fits, self.vehicle, self.campaign.trials, limits, narrow)

    def _beliefs(self, effects: tuple[Effect, ...], between: tuple[Effect, ...]) -> list[Belief]:
        """What the logs say of each rival beside ``effects``, or of those alone where there is none."""
        others = tuple(effect for effect in effects if effect.id not in {rival.id for rival in between})
        models = [(*others, rival) for rival in between] or [others]
        names = [rival.key for rival in between] or ["the model"]
        return [belief_of(self.likelihood(model), name) for model, name in zip(models, names, strict=True)]

    def amplitudes(self, drag: Estimate | None = None) -> Amplitudes:
        """What would make one model agree with all rows of the tables; the steady turns' own drag goes before ``drag``.

        Raises
        ------
        DataError
            There is no table of sine trials.
        """
        if self.sine is None:
            raise DataError("a table of steady turns fits any inertia.", where=self.paths[0], mend="Give logs.")
        steady = None if self.steady is None else read_table(self.steady)
        drag = drag if steady is None else self.drag().estimate
        rigid_body = self.vehicle.rigid_body_inertia
        return explain(read_table(self.sine), steady, drag, self.inertia(drag), rigid_body)

    def position_noise(self) -> float | None:
        """Median standard deviation of the noise of what is measured; None for tables."""
        return None if self.runs is None else self.runs.noise()[0]

    def torque_in_use(self) -> float | None:
        """Median size in N m of the torque while there was any; None where the study has none."""
        if self.runs is not None:
            torque = np.abs(np.concatenate([run.torque for run in self.runs.items]))
        elif self.steady is not None:
            torque = np.abs([point.torque for point in points_from_table(read_table(self.steady))])
        else:
            return None
        acting = torque[torque > 0.0]
        return float(np.median(acting)) if acting.size else None

    def diagnosis(self, report: Callable[[str], None] = lambda _: None, *, drag: Estimate | None = None) -> Diagnosis:
        """What the simulation gets wrong and why; ``report`` is told how far it is.

        Where there are tables of sines alone, ``drag`` is that of the model.

        Raises
        ------
        DataError
            There are neither logs nor a table of sine trials.
        """
        if self.runs is None:
            amplitudes = self.amplitudes(drag)
            return Diagnosis(verdict="too_little_data", missing=amplitudes.missing, amplitudes=amplitudes)
        from rovid.diagnose.algorithm import diagnose

        diagnosis = diagnose(self.runs, self.vehicle, report)
        side = diagnosis.extended or diagnosis.base
        odd = unlike_rigid_body(side.estimate, self.vehicle.measured_inertia) if side else ()
        return replace(
            diagnosis,
            base=self._guessing_side(diagnosis.base),
            extended=self._guessing_side(diagnosis.extended),
            findings=tuple(map(self._guessing_finding, diagnosis.findings)),
            suspects=tuple(map(self._guessing_finding, diagnosis.suspects)),
            warnings=(*diagnosis.warnings, *odd, *self._of_clocks((*diagnosis.findings, *diagnosis.suspects))),
        )

    def _of_clocks(self, findings: Sequence[Finding]) -> Iterator[str]:
        """What else makes a command late, where commands and motion were logged by two clocks that nobody compared."""
        named = {effect.id: effect.title for one in findings for effect in (one.effect, *one.undecided)}
        late = [title for key, title in named.items() if key in _LATE]
        taken = any(
            remark.kind == "joined" for run in (self.runs.items if self.runs else ()) for remark in run.trial.remarks
        )
        if late and taken:
            yield (
                f"The {' or '.join(late)} may be the clocks of the joined files: one that is behind does the same, and "
                "no log tells which. Give what is known of them in [join] offset."
            )

    def _guessing_side(self, side: Side | None) -> Side | None:
        return None if side is None else replace(side, estimate=self._guessing(side.estimate))

    def _guessing_finding(self, finding: Finding) -> Finding:
        return replace(finding, estimate=self._guessing(finding.estimate))


def files_at_hand(paths: Sequence[Path]) -> list[Path]:
    """What may be read where ``paths`` are: logs, tables, rovid.toml and its thrust curves; not what rovid planned."""
    if not paths:
        return []
    files = [path for path in files_in(paths) if path.is_file() and not PLAN.marks(path)]
    return [*files, *settings_at_hand(paths)]


def settings_at_hand(paths: Sequence[Path]) -> list[Path]:
    """The rovid.toml of ``paths`` and its thrust curves, as far as they are there."""
    files: list[Path] = []
    # Whatever is wrong with rovid.toml is said by those who need it.
    with contextlib.suppress(ConfigError):
        config = find_config(paths)
        files.append(config)
        blocks = read_toml(config).get("thrusters")
        tables = [block for block in (blocks if isinstance(blocks, list) else ()) if isinstance(block, dict)]
        curves = [config.parent / str(table["curve"]) for table in tables if "curve" in table]
        files += [curve for curve in curves if curve.exists()]
    return files


def _require_channels(effect: Effect, logged: Collection[str]) -> None:
    missing = " and ".join(name for name in effect.needs if name not in logged)
    if missing:
        text = f"needs {missing}, which these logs do not all hold."
        mend = f"Map {missing} in [signals] of rovid.toml, or leave the effect out."
        raise ConfigError(text, where=effect.key, mend=mend)


def open_study(
    paths: Sequence[Path],
    *,
    cutoff: float | None = None,
    axis: Axis = YAW,
    reading: Reading | None = None,
    without: Collection[Path] = (),
) -> Study:
    """Read whatever ``paths`` hold; ``reading`` and ``without`` as in `read_campaign`.

    Raises
    ------
    RovidError
        The logs or rovid.toml cannot be read.
    """
    steady, sine = find_table(paths, STEADY_COLUMNS), find_table(paths, SINE_COLUMNS)
    if steady is not None or sine is not None:
        if axis is not YAW:
            text = f"{(steady or sine)} is a table of yaw, and no table is read along another axis."
            raise ConfigError(text, where="--axis", mend="Give logs, or leave --axis out.")
        return Study(paths=tuple(paths), vehicle=vehicle_of_tables(paths), steady=steady, sine=sine)
    config = load_config(find_config(paths), axis)
    campaign = read_campaign(paths, config, reading=reading, without=without)
    vehicle = config.vehicle.used(campaign.trials)
    runs = prepare(campaign, vehicle, cutoff=cutoff)
    return Study(paths=tuple(paths), vehicle=vehicle, campaign=campaign, runs=runs, settings=config.settings)
