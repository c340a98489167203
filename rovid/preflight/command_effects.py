"""Effect of each thruster command on the motion, by regression of mean rates on mean commands."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.preflight.raw_columns import MIN_SAMPLES, Log, RawColumn, SignalGuess, held_mean, mean_rates, position_at
from rovid.trial.axis import Axis
from rovid.trial.segments import subsampled_median
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

# Averaging windows of the rates in sampling intervals. In a window that is too short, heading noise makes the
# autocorrelation of the residuals fall below this value.
_WINDOWS, _MIN_AUTOCORRELATION = tuple(5.0 * 2.0**k for k in range(8)), -0.25
# s, step and range of the offsets that are tried between the clocks of two files of one trial, and the window. Clocks
# are set apart by seconds, whatever the vehicle.
_CLOCK_STEP, _MAX_CLOCK_OFFSET, _CLOCK_WINDOW = 0.5, 3.0, 1.0
# Sampling intervals, window after a change of commands, and standard errors by which the rate then changes against it.
# Small vehicles have responded long before: there chance leads to two.
_RESPONSE_WINDOW, _CONTRADICTION = 40.0, 2.2
# Exponents of thrust in the command: a controlled thrust or a torque, and a screw's speed or voltage.
_EXPONENTS = (1.0, 2.0)
# Minimum t statistic of a direction.
_SIGNIFICANT = 4.0
# Minimum t statistic of a direction by all logs but one, for the same direction: that of the usual 95 %.
_AGREES = 2.0
# Minimum of `CommandEffect.size` of a direction: a smaller effect may belong to a correlated command.
_MIN_SIZE = 0.005
# Relative cut-off of eigenvalues; commands that are collinear to this degree share their effect. Single runs of each
# thruster alone among many together leave more.
_COLLINEAR = 1e-3
# Blocks of consecutive windows for the standard errors: enough for a variance within 25 %, each far longer than the
# memory of a disturbance in a campaign of usual length.
_BLOCKS = 32
# Rows for each column of a turn; with fewer the errors are too small (Harrell 2015, section 4.4: 10 to 20).
_MIN_ROWS = 20
# Norm of a command beyond the other regressors, relative to its own norm, below which it is nothing but rounding.
_ROUNDING = 1e-9
# ArduPilot's demand of yaw torque, which its mixer distributes to the outputs.
YAW_DEMAND = "RATE.YOut"
# Minimum R^2 of the demand given the outputs, and minimum coefficient relative to the largest.
_MIXER_R2, _MIXER_SHARE = 0.9, 0.1
# Effect per N m relative to the other thrusters: below this value a thruster is ineffective; standard errors required.
_INEFFECTIVE, _CONFIDENT = 0.2, 3.0
# Effect per N m relative to the other thrusters, up to which a negative one is no other sign: a thruster whose arm is
# turned around pushes about as much as the others. Errors of the curves, as weak reverse thrust, leave less. Decision.
_REVERSED = 1.0 / 3.0


@dataclass(frozen=True, kw_only=True)
class CommandEffect:
    """Effect of one command on the rate, as the logs show it."""

    t_statistic: float = 0.0  #: Of the gain, with errors that allow for autocorrelated residuals.
    #: Share of the variance of the rate that all commands together explain; the shares add up to 1. Negative for a
    #: command that acts against stronger ones.
    explained_share: float = 0.0
    size: float = 0.0  #: Variance that this command alone would cause, relative to that by all commands together.
    gain: float = 0.0  #: Change of the rate over a window per unit of the command, or of its square.
    #: Whether the rate changes against changes of the commands: they then respond to the motion.
    is_contradicted: bool = False

    @property
    def direction(self) -> int:
        """1 or -1, the sign of the gain; 0 where it is not significant."""
        if self.is_contradicted or abs(self.t_statistic) <= _SIGNIFICANT or self.size < _MIN_SIZE:
            return 0
        return int(np.sign(self.t_statistic))

    @property
    def text(self) -> str:
        """Evidence for the direction."""
        share = 100.0 * max(self.explained_share, 0.0)
        return f"{abs(self.t_statistic):.0f} standard errors, {share:.0f} % of what the commands explain"


def command_effects(
    neutral: Mapping[str, float],
    logs: Sequence[Log],
    position: SignalGuess,
    *,
    self_righting: bool = False,
    exponents: Sequence[float] = _EXPONENTS,
    turn: Sequence[SignalGuess] = (),
) -> dict[str, CommandEffect]:
    """Effects of commands, given by source with their ``neutral`` values, on the motion that ``position`` measures.

    The mean rate in each window is regressed on the mean rate in the window before, by itself and squared with its
    sign (drag), and on the mean commands in both, which fits slow and fast vehicles. Feedback within a window can
    reverse the sign: as a check, changes of the rate are regressed on the changes of the commands that precede them.
    Of the ``exponents`` of thrust in the command the one that fits best applies: a straight line through a curve
    misfits each thruster's runs alone alike, which would look like doubt about its direction.

    For surge or sway, ``turn`` is the heading and the velocity along the other one of both: a turn couples them.
    """
    effects = dict.fromkeys(neutral, CommandEffect())
    shaped = [[_shaped(log, neutral, exponent) for log in logs] for exponent in exponents]
    interval = _interval(logs, position)
    for window in (interval * count for count in (_WINDOWS if neutral else ())):
        fits = []
        for these in shaped:
            fit = _regress(
                _windowed(neutral, these, position, window, self_righting=self_righting, turn=turn), len(neutral)
            )
            if fit is not None:
                fits.append((fit, these))
        if not fits:
            break
        fit, logs = max(fits, key=lambda one: one[0].r2)
        columns = (fit.t_statistics, fit.shares, fit.sizes, fit.gains)
        for source, t_statistic, share, size, gain in zip(neutral, *map(np.ndarray.tolist, columns), strict=True):
            effects[source] = CommandEffect(t_statistic=t_statistic, explained_share=share, size=size, gain=gain)
        if fit.autocorrelation > _MIN_AUTOCORRELATION:
            break
    # A vehicle that rights itself swings back without a command.
    if not self_righting and _t_of_changes(effects, logs, position) < -_CONTRADICTION:
        return {source: replace(effect, is_contradicted=True) for source, effect in effects.items()}
    return effects


def _t_of_changes(effects: Mapping[str, CommandEffect], logs: Sequence[Log], position: SignalGuess) -> float:
    """T statistic of changes of the rate after changes of the total drive; 0 for too little data."""
    longest = _RESPONSE_WINDOW * _interval(logs, position)
    for window in (longest, 0.5 * longest):
        blocks = []
        for log, time, rate in _rates_in(logs, position, effects, window):
            if len(rate) >= 4:
                change = np.diff(rate)
                drives = [effect.gain * _mean_command(log[source], time) for source, effect in effects.items()]
                before = np.diff(sum(drives, start=np.zeros(len(rate))))[1:-1]
                blocks.append((np.column_stack((np.ones(len(before)), change[1:-1], change[:-2], before)), change[2:]))
        fit = _regress(blocks, 1)
        if fit is not None:
            return float(fit.t_statistics[0])
    return 0.0


def response_delay(neutral: Mapping[str, float], log: Log, position: SignalGuess) -> float:
    """Time in s, to one window, after which the vehicle responds to commands on another clock; may be negative."""
    if not neutral:
        return 0.0
    r2 = {0.0: 0.0}
    for delay in np.arange(-_MAX_CLOCK_OFFSET, _MAX_CLOCK_OFFSET + _CLOCK_STEP, _CLOCK_STEP).tolist():
        moved = {source: replace(log[source], time=log[source].time + delay) for source in neutral if source in log}
        rows = _windowed(neutral, [{**log, **moved}], position, _CLOCK_WINDOW)
        fit = _regress(rows, len(neutral))
        if fit is not None:
            r2[delay] = fit.r2
    return max(r2, key=lambda delay: r2[delay])


def mixer_directions(neutral: Mapping[str, float], logs: Sequence[Log]) -> dict[str, int]:
    """Sign with which each output follows the autopilot's yaw demand, 0 for none; empty if the demand is not known."""
    blocks = []
    for log in logs:
        if YAW_DEMAND in log and set(neutral) <= set(log):
            demand = log[YAW_DEMAND]
            outputs = [np.interp(demand.time, log[source].time, log[source].values) for source in neutral]
            blocks.append((np.column_stack((np.ones(len(demand.time)), *outputs)), np.nan_to_num(demand.values)))
    fit = _regress(blocks, len(neutral)) if neutral else None
    if fit is None or not fit.r2 >= _MIXER_R2:
        return {}
    shares = fit.gains
    signs = np.where(np.abs(shares) > _MIXER_SHARE * float(np.max(np.abs(shares))), np.sign(shares), 0.0)
    return dict(zip(neutral, signs.astype(int).tolist(), strict=True))


def _interval(logs: Sequence[Log], position: SignalGuess) -> float:
    """Median interval in s between the readings of the position; 1 without any."""
    steps = [np.diff(log[position.source].time) for log in logs if position.source in log]
    known = np.concatenate(steps) if steps else np.zeros(0)
    return subsampled_median(known) if known.size else 1.0


def _rates_in(
    logs: Sequence[Log], position: SignalGuess, sources: Collection[str], window: float
) -> list[tuple[Log, FloatArray, FloatArray]]:
    """Logs with the position and all ``sources``, each with the edges of its windows in s and its mean rates."""
    complete = [log for log in logs if position.source in log and set(sources) <= set(log)]
    return [(log, *mean_rates(position, log[position.source], window)) for log in complete]


def _mean_command(column: RawColumn, edges: FloatArray) -> FloatArray:
    """(m,) means of a command between the (m + 1,) ``edges`` in s; zeros if it was never logged."""
    known = np.isfinite(column.values)
    if not known.any():
        return np.zeros(len(edges) - 1)
    return held_mean(column.time[known], column.values[known], edges)


def _shaped(log: Log, neutral: Mapping[str, float], exponent: float) -> Log:
    """The ``log`` with its commands counted from ``neutral`` and raised to the ``exponent``, with their sign."""
    shaped = dict(log)
    for source, rest in neutral.items():
        if source in log:
            beyond = log[source].values - rest
            shaped[source] = replace(log[source], values=np.sign(beyond) * np.abs(beyond) ** exponent)
    return shaped


def _windowed(
    neutral: Collection[str],
    logs: Sequence[Log],
    position: SignalGuess,
    window: float,
    *,
    self_righting: bool = False,
    turn: Sequence[SignalGuess] = (),
) -> list[tuple[FloatArray, FloatArray]]:
    """For each log (n, 4 + k) rows of a constant, the rate before, its squares and the mean commands, and (n,) rates.

    The squares are those of a drag, with the sign of the rate, and of another drag to the other side.

    A ``self_righting`` axis has the position as a further column in front of the commands; with a ``turn`` these are
    the yaw rate, its product with the other velocity, and both as of a current, which turns with the heading. Logs too
    short for that many columns go without them.
    """
    blocks = []
    for log, time, rate in _rates_in(logs, position, neutral, window):
        if len(rate) < 3:
            continue
        columns = [np.ones(len(rate) - 1), rate[:-1], np.abs(rate[:-1]) * rate[:-1], rate[:-1] ** 2]
        if self_righting:
            columns.append(position_at(position, log[position.source], time[1:-1]))
        if turn and all(one.source in log for one in turn):
            yaw, velocity = (np.diff(position_at(one, log[one.source], time)) / np.diff(time) for one in turn)
            heading = position_at(turn[0], log[turn[0].source], 0.5 * (time[1:] + time[:-1]))
            north, east = np.cos(heading), np.sin(heading)
            products = (yaw, yaw * velocity, north, east, yaw * north, yaw * east)
            columns += [0.5 * (each[1:] + each[:-1]) for each in products]
        for source in neutral:
            command = _mean_command(log[source], time)
            columns.append(0.5 * (command[1:] + command[:-1]))
        blocks.append((np.column_stack(columns), rate[1:]))
    if turn and blocks and sum(len(target) for _, target in blocks) < _MIN_ROWS * blocks[0][0].shape[1]:
        return _windowed(neutral, logs, position, window, self_righting=self_righting)
    return blocks


class _Regression(NamedTuple):
    """Effect of k commands on a target, beyond the other regressors."""

    gains: FloatArray  #: (k,) coefficients of the commands.
    t_statistics: FloatArray  #: (k,)
    shares: FloatArray  #: (k,) shares of the variance that the commands explain.
    sizes: FloatArray  #: (k,) variance by each command alone, relative to that by all.
    r2: float  #: Of all regressors.
    autocorrelation: float  #: Of the residuals, from row to row.


def _regress(blocks: Sequence[tuple[FloatArray, FloatArray]], count: int) -> _Regression | None:
    """Least squares over all blocks of rows and targets; None for fewer than `MIN_SAMPLES` rows.

    The last ``count`` columns are commands. The others, of which the first is constant, are projected out of commands
    and target (Frisch and Waugh 1933): commands that are collinear share the effect that is left, and none of it goes
    to the rate before, which follows the commands of a slow vehicle. The covariance of the gains is that of sums over
    blocks of consecutive rows (Newey and West 1987), at least that of residuals with an autoregression of first order.
    """
    total = sum(len(target) for _, target in blocks)
    if total < MIN_SAMPLES:
        return None
    rows = np.nan_to_num(np.concatenate([block for block, _ in blocks]))
    target = np.concatenate([target for _, target in blocks])
    others, commands = rows[:, :-count], rows[:, -count:]
    scale = np.linalg.norm(others, axis=0)
    left, sizes, _ = np.linalg.svd(others / np.where(scale > 0.0, scale, 1.0), full_matrices=False)
    basis = left[:, sizes > _ROUNDING * sizes[0]]
    y = target - basis @ (basis.T @ target)
    x = commands - basis @ (basis.T @ commands)
    # Unit columns: a command in us would otherwise outweigh a command in V.
    norm = np.linalg.norm(x, axis=0)
    norm = np.where(norm > _ROUNDING * np.linalg.norm(commands, axis=0), norm, np.inf)
    x = x / norm
    inverse = np.linalg.pinv(x.T @ x, rcond=_COLLINEAR, hermitian=True)
    values = inverse @ (x.T @ y)
    driven = x @ values
    power = max(float(driven @ driven), 1e-300)
    residual = y - driven
    squares, free = float(residual @ residual), rows.shape[1]
    autocorrelation = float(residual[1:] @ residual[:-1]) / max(squares, 1e-300)
    positive = min(max(autocorrelation, 0.0), 0.98)
    least = np.diag(inverse) * (1.0 + positive) / (1.0 - positive) * squares / max(total - free, 1)
    starts = _block_starts([len(target) for _, target in blocks])
    scores = np.add.reduceat(x * residual[:, None], starts, axis=0) @ inverse
    scatter = np.sum(scores**2, axis=0) * len(starts) / max(len(starts) - free, 1)
    errors = np.sqrt(np.maximum(least, scatter))
    # A column of zeros has no error; one that is nothing but rounding has no effect either.
    known = (errors > 0.0) & np.isfinite(norm)
    deviation = target - target.mean()
    return _Regression(
        gains=values / norm,
        t_statistics=np.where(known, values / np.where(known, errors, 1.0), 0.0),
        shares=(driven @ x) * values / power,
        sizes=(values * np.linalg.norm(x, axis=0)) ** 2 / power,
        r2=1.0 - squares / max(float(deviation @ deviation), 1e-300),
        autocorrelation=autocorrelation,
    )


def _block_starts(lengths: Sequence[int]) -> IntArray:
    """First rows of about `_BLOCKS` blocks of equal length, none of which extends over two logs."""
    size = max(sum(lengths) // _BLOCKS, 1)
    firsts = np.concatenate(([0], np.cumsum(lengths)[:-1]))
    starts = []
    for first, length in zip(firsts.tolist(), lengths, strict=True):
        count = max(length // size, 1)
        starts.append(first + np.arange(count) * length // count)
    return np.concatenate(starts)


# ---- thrusters of rovid.toml


@dataclass(frozen=True, kw_only=True)
class ThrusterCheck:
    """Effect of one thruster of rovid.toml as the logs show it."""

    name: str
    observed: CommandEffect  #: Effect of its torque, or force, by arm and curve: the gain should be positive.
    #: ``strength``, ``error``: effect per N m relative to the weighted mean of all thrusters, with its standard error;
    #: 1 where arms and curves are right in proportion, NaN where the logs do not determine it.
    strength: float
    error: float

    @property
    def is_reversed(self) -> bool:
        """Whether it acts against its sign in rovid.toml."""
        return self.observed.direction < 0

    @property
    def is_ineffective(self) -> bool:
        """Whether it has next to no effect, by three standard errors."""
        return abs(self.strength) + _CONFIDENT * self.error < _INEFFECTIVE

    def text(self, axis: Axis) -> str:
        """Advice on a thruster that is reversed or ineffective; else empty."""
        if self.is_reversed:
            text = f"Turn {axis.arm_key} of {self.name} around, or correct the mapping of its command: more of its "
            return f"{text}{axis.force_name} makes the {axis.position_words} fall ({self.observed.text})."
        if self.is_ineffective:
            words = f"Leave {self.name} out, or check its {axis.arm_key}, curve and command: it {axis.motion_verb} the "
            words += f"vehicle by {100.0 * self.strength:.0f} ± {100.0 * self.error:.0f} % of what the other thrusters "
            return f"{words}make expect."
        return ""


def all_reversed(checks: Sequence[ThrusterCheck], axis: Axis) -> str:
    """Advice where each of several thrusters is reversed, as by a heading counted to port (ENU); else empty."""
    if len(checks) < 2 or not all(check.is_reversed for check in checks):
        return ""
    text = f"More {axis.force_name} of every thruster makes the {axis.position_words} fall. Give the "
    return f"{text}{axis.position_words} sign = -1 in [signals] of rovid.toml, or turn each {axis.arm_key} around."


def check_thrusters(trials: Sequence[Trial], vehicle: Vehicle) -> list[ThrusterCheck]:
    """Check of each thruster against the motion in ``trials``; none for a vehicle without thrusters."""
    names = [thruster.name for thruster in vehicle.thrusters]
    if not names or not trials:
        return []
    logs = []
    for trial in trials:
        log = {"": RawColumn(source="", time=trial.time, values=trial.position)}
        for thruster, command in zip(vehicle.thrusters, trial.commands.T, strict=True):
            log[thruster.name] = RawColumn(source=thruster.name, time=trial.time, values=thruster.torque(command))
        logs.append(log)
    position = SignalGuess(source="", reason="", unit="rad" if vehicle.axis.angular else "m")
    neutral = dict.fromkeys(names, 0.0)
    # Curves give the torque, whatever its exponent in the command.
    examine = partial(
        command_effects, neutral, position=position, self_righting=vehicle.axis.self_righting, exponents=_EXPONENTS[:1]
    )
    effects = examine(logs)
    if len(logs) > 2 and any(effect.direction < 0 for effect in effects.values()):
        # One log turns no arm around, if the others alone do not agree: there a thruster failed, columns changed place,
        # or the thrust had not yet faded; and a wrong curve is seen in the log with other commands than the rest.
        for at in range(len(logs)):
            for name, rest in examine([*logs[:at], *logs[at + 1 :]]).items():
                if effects[name].direction < 0 and rest.t_statistic > -_AGREES:
                    effects[name] = replace(effects[name], is_contradicted=True)
    errors = {name: abs(one.gain / one.t_statistic) if one.t_statistic else np.inf for name, one in effects.items()}
    weights = np.array([errors[name] ** -2.0 for name in names])
    gains = np.array([effects[name].gain for name in names])
    mean = float(weights @ np.abs(gains)) / max(float(weights.sum()), 1e-300)
    if not mean > 0.0:
        mean = np.nan
    for name, effect in effects.items():
        if -_REVERSED < effect.gain / mean < 0.0:
            effects[name] = replace(effect, is_contradicted=True)
    return [
        ThrusterCheck(name=name, observed=effects[name], strength=effects[name].gain / mean, error=errors[name] / mean)
        for name in names
    ]
