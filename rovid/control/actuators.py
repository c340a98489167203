"""Actuators of the heading controller: allocation of torque, frequency response, and the loops of autopilots.

ArduPilot, from its sources (AC_PID.cpp, AC_AttitudeControl_Sub.cpp, AR_AttitudeControl.cpp): a P on the heading error
gives the wanted yaw rate, and a filtered PID with feedforward on the rate of the gyro gives the output from -1 to 1.
PX4, from its source (uuv_att_control.cpp): the output is UUV_YAW_P * sin(error) - UUV_YAW_D * rate, which is the same
cascade without integral and filters. A mixer turns the output into equal shares of the commands of all thrusters.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from rovid.control.control_law import LoopConditions
from rovid.control.tuning import OpenLoop, largest_bandwidth, linearise, pd_gains
from rovid.core.array_types import ComplexArray, FloatArray
from rovid.core.errors import DataError
from rovid.effects.actuator_inputs import ActuatorInputs, actuator_inputs, neutral_commands
from rovid.model.actuator_model import CommandSeries
from rovid.model.model import Model
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

# Number of torques each way in the table, and the smallest one relative to the largest.
_LEVELS, _TINY = 501, 1e-9
# N m, torques of an actuator that takes the torque itself as its command.
_UNLIMITED = np.append(0.0, np.geomspace(1e-2, 1e6, _LEVELS - 1))
# Number of frequencies in the response, the lowest in rad/s, and the highest relative to the Nyquist frequency.
_FREQUENCIES, _LOWEST, _HIGHEST = 18, 0.02, 0.9
# s, shortest time before the response is read, and minimum number of samples of a sine.
_SETTLING, _MIN_SAMPLES = 20.0, 40


@dataclass(frozen=True, kw_only=True, eq=False)
class Allocation:
    """Commands with each thruster at the same share of its range beyond the dead zone, in the sense of the torque."""

    #: ``torque``, ``commands``: (m,) N m, increasing, and (m, k); the commands jump over the dead zone at zero torque.
    torque: FloatArray
    commands: FloatArray
    limited: bool  #: Whether a bench curve limits the torque.
    inverse: bool = True  #: Whether the commands exert ``torque``; else only a nominal torque.

    @property
    def lowest(self) -> float:
        """Most negative torque in N m."""
        return float(self.torque[0]) if self.limited else -math.inf

    @property
    def highest(self) -> float:
        """Largest torque in N m."""
        return float(self.torque[-1]) if self.limited else math.inf

    def __call__(self, torque: FloatArray) -> FloatArray:
        """(n, k) commands for (n,) ``torque`` in N m, saturated at the limits."""
        return np.column_stack([np.interp(torque, self.torque, column) for column in self.commands.T])


def allocate(vehicle: Vehicle, model: Model) -> Allocation:
    """Inverse of the steady torque of ``vehicle`` with the effects of ``model``."""
    up, forward = _one_way(vehicle, model, 1.0)
    down, backward = _one_way(vehicle, model, -1.0)
    return Allocation(
        torque=np.concatenate((-down[::-1], [0.0], up)),
        commands=np.concatenate((backward[::-1], [neutral_commands(vehicle)], forward)),
        limited=any(thruster.curve is not None for thruster in vehicle.thrusters),
    )


def _one_way(vehicle: Vehicle, model: Model, sign: float) -> tuple[FloatArray, FloatArray]:
    """(m,) absolute torques, increasing from nearly zero, and their (m, k) commands, for torques of one sign."""
    where = bare_inputs(vehicle, np.array([0.0, 1.0]))
    share = np.linspace(0.0, 1.0, _LEVELS)
    columns = []
    for at, thruster in enumerate(vehicle.thrusters):
        sense = math.copysign(1.0, thruster.arm) * sign
        if thruster.curve is None:
            columns.append(sense * _UNLIMITED)
            continue
        side = 1 if sense > 0.0 else 0
        edge, end = where.dead_zone[at][side], thruster.curve.command[-side]
        columns.append(edge + share * (end - edge))
    commands = np.column_stack(columns)
    torque = np.maximum.accumulate(np.maximum(sign * command_torque(vehicle, model, commands), 0.0))
    # Among commands with equal torque the largest one, and at the top the smallest one.
    keep = np.append(np.diff(torque) > 0.0, False) | (np.arange(_LEVELS) == np.searchsorted(torque, torque[-1]))
    torque, commands = torque[keep], commands[keep]
    torque[0] = max(torque[0], _TINY * torque[-1])
    return torque, commands


def command_torque(vehicle: Vehicle, model: Model, commands: FloatArray) -> FloatArray:
    """(m,) torque in N m at the beginning of a trial with each of (m, k) ``commands``."""
    trials = ActuatorInputs.concatenated([bare_inputs(vehicle, np.array([0.0, 1.0]))] * len(commands))
    series = CommandSeries(vehicle, trials, np.repeat(commands, 2, axis=0))
    return model.actuators.torque_inputs(series).torque[::2]


def bare_inputs(vehicle: Vehicle, time: FloatArray, parts: int = 1) -> ActuatorInputs:
    """Actuator inputs at the (n,) ``time`` in s, without further channels."""
    still = np.zeros((len(time), len(vehicle.thrusters)))
    return actuator_inputs(vehicle, Trial.from_commands(time, still), parts)


@dataclass(frozen=True, kw_only=True, eq=False)
class ActuatorProbe:
    """Sines of wanted torque for the frequency response."""

    vehicle: Vehicle
    parts: int  #: Number of parts of each interval for the effects between command and torque.
    allocation: Allocation
    #: ``period``, ``amplitude``: sampling period in s; N m.
    period: float
    amplitude: float

    @property
    def frequencies(self) -> FloatArray:
        """(f,) in rad/s."""
        return np.geomspace(_LOWEST, _HIGHEST * math.pi / self.period, _FREQUENCIES)

    def frequency_response(self, model: Model) -> tuple[FloatArray, ComplexArray]:
        """Frequencies in rad/s and the (f,) describing function from wanted to acting torque.

        Raises DataError if an effect acts between command and torque, and the thrusters turn the vehicle one way only.
        """
        if model.actuators.is_plain and self.allocation.inverse:
            return self.frequencies, np.ones(_FREQUENCIES, dtype=np.complex128)
        series, readings = self._sines
        torque = model.actuators.torque_inputs(series).torque
        return self.frequencies, np.array([weights @ torque[rows] for rows, weights in readings])

    @cached_property
    def _sines(self) -> tuple[CommandSeries, list[tuple[slice, ComplexArray]]]:
        """Commands of all sines in succession; for each, the settled rows and the weights of its response there."""
        if not self.amplitude > 0.0:
            raise one_way_only()
        begin, where, commands, readings = 0, [], [], list[tuple[slice, ComplexArray]]()
        for frequency in self.frequencies.tolist():
            length = max(round(2.0 * math.pi / frequency / self.period), _MIN_SAMPLES)
            count = length + max(length, math.ceil(_SETTLING / self.period))
            time = self.period * np.arange(count + 1)
            where.append(bare_inputs(self.vehicle, time, self.parts))
            commands.append(self.allocation(self.amplitude * np.sin(frequency * time)))
            # Least squares fit of exp(i w t), exp(-i w t) and a constant. The sine itself has the coefficient
            # amplitude / 2j.
            settled = time[count - length : count]
            ahead, back = np.exp(1j * frequency * settled), np.exp(-1j * frequency * settled)
            weights = np.linalg.pinv(np.column_stack((ahead, back, np.ones(len(settled)))))[0] / (self.amplitude / 2j)
            readings.append((slice(begin + count - length, begin + count), weights))
            begin += count + 1
        return CommandSeries(self.vehicle, ActuatorInputs.concatenated(where), np.concatenate(commands)), readings


def one_way_only() -> DataError:
    """Error for thrusters that turn the vehicle one way only."""
    return DataError("the thrusters turn the vehicle one way only.", mend="Check yaw_arm and curve in rovid.toml.")


# Cut-off of the filters and corner of the integral, relative to the natural frequency of the loop.
_FILTERS, _INTEGRAL = 10.0, 0.1
# Limit of the integral's part of the output.
_INTEGRAL_LIMIT = 0.5
# Derivative gain over proportional gain, in lags of the actuators at low frequency; the best one is taken.
_LEADS = (0.0, 0.5, 1.0)
# s, shortest lag of the actuators that a derivative gain compensates, and sampling of the actuators' response.
_LEAST_LAG, _SAMPLING = 0.02, 0.02
# rad, heading error that may saturate the thrusters; torque due to noise relative to the torque in use.
SATURATING_ERROR, NOISE_SHARE = 0.2, 0.1
# Number of significant digits of the gains: those in a file are those that are judged.
_DIGITS = 4


@dataclass(frozen=True, kw_only=True)
class AutopilotLaw:
    """P on the heading error, and a PID with feedforward on the yaw rate; gains are in output units, rad and s."""

    angle: float  #: 1/s.
    proportional: float
    integral: float = 0.0
    derivative: float = 0.0
    feedforward: float = 0.0
    #: ``target_filter``, ``error_filter``, ``derivative_filter``: cut-off in Hz; 0 without filter.
    target_filter: float = 0.0
    error_filter: float = 0.0
    derivative_filter: float = 0.0
    integral_limit: float = 0.0
    period: float  #: s.
    #: ``full``, ``gain``: N m, nominal torque of an output of 1; torque over nominal torque at the judged amplitude.
    full: float
    gain: float = 1.0

    @property
    def kp(self) -> float:
        """Torque per heading error in N m/rad, without integral."""
        return self.angle * (self.proportional + self.feedforward) * self.full * self.gain

    @property
    def kd(self) -> float:
        """Torque per yaw rate in N m s/rad."""
        return self.proportional * self.full * self.gain

    @property
    def lag(self) -> float:
        """Lag in s at low frequency, hold included."""
        filters = (self.target_filter, self.error_filter)
        return 0.5 * self.period + sum(0.5 / (math.pi * hertz) for hertz in filters if hertz)

    def noise(self, heading_noise: float) -> float:
        """Standard deviation in N m of the torque under white ``heading_noise`` in rad."""
        return self.kp * heading_noise

    def feedback(self, frequency: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """(f,) negative wanted torque per heading, and per yaw rate."""
        back = np.exp(-1j * frequency * self.period)

        def filtered(hertz: float) -> ComplexArray | float:
            if not hertz:
                return 1.0
            weight = self.period / (self.period + 0.5 / (math.pi * hertz))
            return np.asarray(weight / (1.0 - (1.0 - weight) * back))

        change = (1.0 - back) / self.period
        pid = self.proportional + self.integral / change + self.derivative * filtered(self.derivative_filter) * change
        rate = pid * filtered(self.error_filter)
        heading = self.angle * filtered(self.target_filter) * (rate + self.feedforward)
        return np.asarray(self.full * heading), np.asarray(self.full * rate)


class Autopilot(NamedTuple):
    """An autopilot's loop: period in s, whether it is ArduPilot's cascade, and names of its gains."""

    title: str
    period: float
    cascade: bool
    names: Mapping[str, str]  #: Name of the parameter -> name of the field of `AutopilotLaw`.


def _ardupilot(angle: str, rate: str, *, feedforward: bool) -> dict[str, str]:
    fields = {"P": "proportional", "I": "integral", "D": "derivative"}
    if feedforward:
        fields["FF"] = "feedforward"
    fields |= {"IMAX": "integral_limit", "FLTT": "target_filter", "FLTE": "error_filter", "FLTD": "derivative_filter"}
    return {angle: "angle", **{rate + key: field for key, field in fields.items()}}


# By the names of `rovid control --law`. ArduSub calls update_all without get_ff: its FF does not act.
# Periods: SCHED_LOOP_RATE of 400 Hz, 0.02 s of Rover, 250 Hz of PX4.
AUTOPILOTS: Mapping[str, Autopilot] = {
    "ardusub": Autopilot("ArduSub", 0.0025, True, _ardupilot("ATC_ANG_YAW_P", "ATC_RAT_YAW_", feedforward=False)),
    "ardurover": Autopilot("ArduRover", 0.02, True, _ardupilot("ATC_STR_ANG_P", "ATC_STR_RAT_", feedforward=True)),
    "px4": Autopilot("PX4", 0.004, False, {"UUV_YAW_P": "output_gain", "UUV_YAW_D": "proportional"}),
}


def autopilot_parameters(autopilot: Autopilot, law: AutopilotLaw) -> dict[str, float]:
    """Value of each parameter of the autopilot, by its name."""
    values = vars(law) | {"output_gain": _rounded(law.angle * law.proportional)}
    return {name: values[field] for name, field in autopilot.names.items()}


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


def mixed_commands(vehicle: Vehicle, model: Model) -> Allocation:
    """Each thruster at the share of its range that is the output, in the sense of the torque, as an autopilot's mixer.

    The curve of the torque is not inverted: ``torque`` is the output times the smaller torque of full output. Raises
    DataError if the thrusters turn the vehicle one way only.
    """
    columns = []
    for thruster, neutral in zip(vehicle.thrusters, neutral_commands(vehicle), strict=True):
        if thruster.curve is None:
            low, high = -thruster.max_logged_torque, thruster.max_logged_torque
        else:
            low, high = thruster.curve.command[[0, -1]].tolist()
        if thruster.arm > 0.0:
            columns.append((low, neutral, high))
        elif thruster.arm < 0.0:
            columns.append((high, neutral, low))
        else:
            columns.append((neutral, neutral, neutral))
    commands = np.array(columns).T
    torque = command_torque(vehicle, model, commands)
    full = min(float(torque[2]), -float(torque[0]))
    if not full > 0.0:
        raise one_way_only()
    return Allocation(torque=full * np.array([-1.0, 0.0, 1.0]), commands=commands, limited=True, inverse=False)


def autopilot_loop(
    model: Model,
    vehicle: Vehicle,
    conditions: LoopConditions,
    autopilot: Autopilot,
    gains_of: Callable[[float], tuple[float, float]],
    bandwidth: float | None = None,
) -> tuple[AutopilotLaw, OpenLoop, ActuatorProbe]:
    """Law and loop of ``autopilot`` at the natural frequency ``bandwidth`` in rad/s, by default the largest one.

    The actuators have the amplitude of the torque in use or of full output, whichever has the larger gain. The probe
    repeats their response for another model. ``gains_of`` maps the bandwidth to kp and kd in N m/rad and N m s/rad.
    Raises DataError if no bandwidth has sufficient margins, or the thrusters turn the vehicle one way only.
    """
    mixer, fastest = mixed_commands(vehicle, model), model.steady_rate(conditions.torque_in_use)
    probe = ActuatorProbe(
        vehicle=vehicle,
        parts=model.actuators.subdivision,
        allocation=mixer,
        period=max(autopilot.period, _SAMPLING),
        amplitude=min(conditions.torque_in_use, 0.5 * mixer.highest),
    )
    probes = probe, replace(probe, amplitude=mixer.highest)
    probe = max(probes, key=lambda one: float(np.abs(one.frequency_response(model)[1][0])))
    frequencies, response = actuators = probe.frequency_response(model)
    gain, late = float(np.abs(response[0])), max(float(-np.angle(response[0]) / frequencies[0]), 0.0)
    full = gain * mixer.highest

    def law_at(bandwidth: float, lead: float) -> AutopilotLaw:
        kp, kd = gains_of(bandwidth)
        law = AutopilotLaw(
            angle=kp / kd, proportional=_rounded(kd / full), period=autopilot.period, full=mixer.highest, gain=gain
        )
        if not autopilot.cascade:
            return law
        hertz = _rounded(_FILTERS * bandwidth / (2.0 * math.pi))
        feedforward = _rounded(model.linear_drag / full) if "feedforward" in autopilot.names.values() else 0.0
        return replace(
            law,
            angle=_rounded(kp / (kd + feedforward * full)),
            integral=_rounded(_INTEGRAL * bandwidth * kd / full),
            derivative=_rounded(lead * kd / full),
            feedforward=feedforward,
            target_filter=hertz,
            error_filter=hertz,
            derivative_filter=hertz,
            integral_limit=_INTEGRAL_LIMIT,
        )

    template = OpenLoop(
        law=law_at(1.0, 0.0), motion=linearise(model, fastest), actuators=actuators, delay=conditions.delay
    )
    if bandwidth is not None:
        law = law_at(bandwidth, 0.0)
        return law, replace(template, law=law), probe
    limit = math.sqrt(full / SATURATING_ERROR / model.inertia)
    if conditions.heading_noise > 0.0:
        most = NOISE_SHARE * conditions.torque_in_use / conditions.heading_noise
        limit = min(limit, math.sqrt(most / model.inertia))
    leads = _LEADS if autopilot.cascade and late > _LEAST_LAG else _LEADS[:1]
    found: list[tuple[float, float]] = []
    refusal: DataError | None = None
    for lead in (share * late for share in leads):

        def loop_of(bandwidth: float, lead: float = lead) -> OpenLoop:
            return replace(template, law=law_at(bandwidth, lead))

        try:
            found.append((largest_bandwidth(loop_of, limit), lead))
        except DataError as error:
            refusal = error
    if not found and refusal is not None:
        raise refusal
    # Of equal bandwidths the one with the smallest derivative gain.
    law = law_at(*max(found, key=lambda one: (one[0], -one[1])))
    return law, replace(template, law=law), probe


def default_gains(model: Model, damping: float) -> Callable[[float], tuple[float, float]]:
    """Gains kp and kd of a bandwidth, for the ``damping`` ratio with the yaw inertia."""
    return lambda bandwidth: pd_gains(model.inertia, damping, bandwidth)
