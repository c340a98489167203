"""Guess of the contents of columns from names, values and the response of the vehicle."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.preflight.axis_guess import guess_planar
from rovid.preflight.raw_columns import RawColumn
from rovid.preflight.signal_guess import map_columns
from rovid.preflight.thruster_guess import GuessHints
from rovid.trial.axis import AXES

TIME = np.arange(0.0, 400.0, 0.1)
# Held for 20 s each, in no order.
LEVELS = np.random.default_rng(3).choice([-2.0, -1.0, 0.0, 1.0, 2.0], 20)
COMMAND = np.repeat(LEVELS, 200)


def turned(command: FloatArray) -> FloatArray:
    """Heading in deg, within a turn, of a vehicle that follows its command with a time constant of 5 s."""
    rate, heading = 0.0, [0.0]
    for value in command[:-1]:
        rate += 0.1 * (value - rate) / 5.0
        heading.append(heading[-1] + 3.0 * rate * 0.1)
    return np.asarray(heading) % 360.0


def log(**columns: FloatArray) -> dict[str, RawColumn]:
    return {name: RawColumn(source=name, time=TIME, values=values) for name, values in columns.items()}


@pytest.mark.parametrize("way", [1, -1])
def test_directions_follow_from_the_motion(way: int) -> None:
    idle = np.random.default_rng(4).choice([-1.0, 1.0], len(TIME))
    found = map_columns([log(heading=turned(way * COMMAND), fore_cmd=COMMAND, aft_cmd=idle)])
    assert {command.name: command.direction for command in found.commands} == {"fore": way, "aft": 0}
    assert not found.missing


def test_an_unnamed_heading_is_recognised_by_its_jumps() -> None:
    found = map_columns([log(channel_7=turned(COMMAND), channel_8=np.sin(TIME), fore_cmd=COMMAND)])
    assert found.signals["heading"].source == "channel_7"
    assert found.signals["heading"].unit == "deg"


def test_a_heading_in_hundredths_of_a_degree_wraps_at_its_own_turn() -> None:
    time = 0.1 * np.arange(3000, dtype=np.float64)
    hundredths = np.asarray(np.round(np.mod(1200.0 * time, 36000.0)), dtype=np.float64)
    log = {name: RawColumn(source=name, time=time, values=values) for name, values in {"hdg": hundredths}.items()}
    assert map_columns([log]).signals["heading"].unit == "0.01 deg"


def test_unit_and_sign_of_a_gyro_follow_from_the_heading() -> None:
    heading = turned(COMMAND)
    rate = np.gradient(np.unwrap(np.radians(heading)), TIME)
    found = map_columns([log(heading=heading, yaw_rate=-rate, fore_cmd=COMMAND)])
    gyro = found.signals["yaw_rate"]
    assert (gyro.unit, gyro.sign) == ("rad/s", -1)
    found = map_columns([log(heading=heading, yaw_rate=np.degrees(rate), fore_cmd=COMMAND)])
    gyro = found.signals["yaw_rate"]
    assert (gyro.unit, gyro.sign) == ("deg/s", 1)


def test_the_supply_voltage_is_no_command() -> None:
    supply = 24.0 - 0.1 * np.abs(COMMAND)
    found = map_columns([log(heading=turned(COMMAND), fore_cmd=COMMAND, battery_volts=supply)])
    assert found.signals["supply_voltage"].source == "battery_volts"
    assert [command.source for command in found.commands] == ["fore_cmd"]


def test_pulse_widths_have_their_neutral_value_in_the_middle() -> None:
    found = map_columns([log(heading=turned(COMMAND), fore_pwm=1500.0 + 100.0 * COMMAND)])
    assert found.commands[0].neutral == 1500.0


def test_thrusters_get_unique_names() -> None:
    # The third would be called as the second is.
    found = map_columns(
        [log(heading=turned(COMMAND), a_cmd=COMMAND, a_3_cmd=COMMAND**2, a_volts=np.roll(COMMAND, 300))]
    )
    assert [command.name for command in found.commands] == ["a", "a_3", "a_4"]


def test_the_supply_of_a_flight_controller_does_not_hide_its_motors() -> None:
    supply = 24.0 - 0.1 * np.abs(COMMAND)
    columns = {"vbatLatest (V)": supply, "voltage_filtered_v": supply, "motor[0]": 1500.0 + 200.0 * COMMAND}
    found = map_columns([log(**{"heading[2]": np.radians(turned(COMMAND)), **columns})])
    assert [command.source for command in found.commands] == ["motor[0]"]
    assert "command" in map_columns([log(heading=turned(COMMAND), voltage_filtered_v=supply)]).missing


def test_a_pressure_in_psi_hides_no_heading() -> None:
    found = map_columns([log(Int_PSI=11.2 + 0.1 * np.sin(TIME), HeadDeg=turned(COMMAND), fore_cmd=COMMAND)])
    assert found.signals["heading"].source == "HeadDeg"
    assert map_columns([log(ship_psi=np.radians(turned(COMMAND)))]).signals["heading"].source == "ship_psi"


def test_a_roll_has_the_unit_of_its_own_name() -> None:
    roll = 0.02 * np.sin(TIME)
    columns = {"att.roll": roll, "att.yaw_deg": turned(COMMAND), "att.roll_deg": np.degrees(roll)}
    found = map_columns([log(**columns)])
    assert (found.signals["roll"].source, found.signals["roll"].unit) == ("att.roll_deg", "deg")


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_the_track_shows_the_unit_of_a_heading_of_many_turns(unit: str) -> None:
    # The speed ahead turns with the heading, in either unit; a drift of the course is no turn.
    angle = np.cumsum(0.05 * COMMAND + 0.02)
    x, y = np.cumsum(np.cos(angle + 0.1)), np.cumsum(np.sin(angle + 0.1))
    heading = angle if unit == "rad" else np.degrees(angle)
    found = map_columns([log(x=x, y=y, psi=heading, fore_cmd=COMMAND)])
    assert found.signals["heading"].unit == unit


def test_missing_columns_are_reported() -> None:
    found = map_columns([log(depth=np.sin(TIME))])
    assert found.missing == ("heading", "command")


@pytest.mark.parametrize(
    ("heading", "rate"),
    [
        ("Kurs", "Gierrate"), ("Steuerkurs_grad", "Drehrate_grad_s"), ("kurs_deg", "Wendegeschwindigkeit"),
        ("cap", "vitesse_de_lacet"), ("lacet_deg", "vitesse lacet dps"), ("cap (°)", "lacet (°/s)"),
        ("rumbo_grados", "velocidad_guiñada"), ("girvinkel", "girrate_dps"), ("kurs", "svingerate"),
        ("bussola_gradi", "velocita_imbardata"), ("HdgDeg", "RateOfTurnDps"),
    ],
)  # fmt: skip
def test_headings_and_yaw_rates_in_other_languages(heading: str, rate: str) -> None:
    angle = turned(COMMAND)
    turning = np.degrees(np.gradient(np.unwrap(np.radians(angle)), TIME))
    found = map_columns([log(**{rate: turning, heading: angle, "T1": COMMAND})])
    assert found.signals["heading"].source == heading
    assert (found.signals["yaw_rate"].source, found.signals["yaw_rate"].unit) == (rate, "deg/s")
    assert [command.source for command in found.commands] == ["T1"]


def test_a_torque_is_recognised_by_its_symbol_and_preferred_to_pilot_input() -> None:
    found = map_columns([log(heading=turned(COMMAND), N=COMMAND, joystick_x=COMMAND)])
    assert found.signals["torque"].source == "N"
    assert not found.commands


def test_next_to_a_torque_a_voltage_is_no_command() -> None:
    found = map_columns(
        [log(heading=turned(COMMAND), **{"thr.yaw_torque_Nm": COMMAND, "sys.tension_V": COMMAND - 0.5})]
    )
    assert found.signals["torque"].source == "thr.yaw_torque_Nm"
    assert not found.commands


# ---- the axes but yaw


def found(axis: str, *names: str, size: float = 1.0) -> dict[str, tuple[str, str, int]]:
    """Signal -> source, unit and sign, for columns with these names."""
    rng = np.random.default_rng(2)
    columns = {name: size * rng.uniform(-1.0, 1.0, len(TIME)) for name in names}
    mapping = map_columns([log(**columns)], GuessHints(axis=AXES[axis]))
    return {name: (one.source, one.unit, one.sign) for name, one in mapping.signals.items()}


@pytest.mark.parametrize(
    ("axis", "column", "signal", "unit", "sign"),
    [
        ("surge", "surge_velocity_m_s", "surge_velocity", "m/s", 1),
        ("surge", "u_m_s", "surge_velocity", "m/s", 1),
        ("surge", "dvl.vx", "surge_velocity", "m/s", 1),
        ("surge", "Vitesse Avance [m/s]", "surge_velocity", "m/s", 1),
        ("surge", "STW (kn)", "surge_velocity", "kn", 1),
        ("surge", "SurgeMps", "surge_velocity", "m/s", 1),
        ("surge", "surge_position_cm", "surge_position", "cm", 1),
        ("sway", "sway_velocity_mps", "sway_velocity", "m/s", 1),
        ("heave", "Tiefe (m)", "depth", "m", 1),
        ("heave", "profondeur", "depth", "m", 1),
        ("heave", "altitude_m", "depth", "m", -1),
        ("heave", "heave_velocity_m_s", "heave_velocity", "m/s", 1),
        ("roll", "roll_rad", "roll", "rad", 1),
        ("roll", "Krängung [Grad]", "roll", "deg", 1),
        ("roll", "gite_deg", "roll", "deg", 1),
        ("pitch", "assiette (deg)", "pitch", "deg", 1),
    ],
)
def test_common_names_of_other_axes(axis: str, column: str, signal: str, unit: str, sign: int) -> None:
    others = ("heading_deg", "yaw_rate_dps", "port_V", "battery_pct", "vertical_port_pct", "depth_setpoint_m")
    assert found(axis, column, *others)[signal] == (column, unit, sign)


def test_a_tilt_rate_requires_the_tilt() -> None:
    assert set(found("roll", "roll_deg", "roll_rate_dps")) == {"roll", "roll_rate"}
    assert not found("roll", "roll_rate_dps")


def test_a_tilt_beyond_upright_is_in_degrees() -> None:
    assert found("pitch", "pitch", size=12.0)["pitch"][1] == "deg"
    assert found("pitch", "pitch", size=0.4)["pitch"][1] == "rad"


def test_thruster_commands_are_no_motion() -> None:
    assert not found("heave", "vertical_pct", "motor_vertikal_babord", "heave_cmd")


ERRORS = (
    "e_heading",
    "heading_e",
    "heading_error",
    "headingErr",
    "err_yaw",
    "yaw_err",
    "psi_e",
    "yawError",
    "heading error",
    "delta_heading",
    "heading_diff",
    "Kursabweichung",
    "erreur_cap",
)
ORDERS = (
    "heading_ref",
    "psi_d",
    "heading_des",
    "yaw_sp",
    "heading_setpoint",
    "ordered_heading",
    "heading_goal",
    "yaw_c",
)


@pytest.mark.parametrize("name", [*ERRORS, *ORDERS])
def test_an_error_or_an_order_is_no_heading(name: str) -> None:
    """Neither beside the heading nor alone, though it jumps by a whole turn."""
    found = map_columns([log(**{name: turned(COMMAND)[::-1].copy(), "heading": turned(COMMAND), "fore_cmd": COMMAND})])
    assert found.signals["heading"].source == "heading"
    alone = map_columns([log(**{name: turned(COMMAND), "fore_cmd": COMMAND})])
    assert "heading" not in alone.signals
    assert alone.missing == ("heading",)


@pytest.mark.parametrize(
    "name", ["heading", "heading_deg", "true_heading", "yaw", "imu_yaw", "hdg", "HDT", "psi", "ATT.Yaw"]
)
def test_measured_headings_are_headings(name: str) -> None:
    assert map_columns([log(**{name: turned(COMMAND), "fore_cmd": COMMAND})]).signals["heading"].source == name


@pytest.mark.parametrize("names", [("/pose.x", "/pose.y", "/pose.theta"), ("x", "y", "theta")])
def test_the_angle_of_a_planar_pose_is_the_heading(names: tuple[str, str, str]) -> None:
    angle = np.radians(turned(COMMAND))
    found = map_columns([log(**dict(zip(names, (np.sin(TIME), np.cos(TIME), angle), strict=True)), fore_cmd=COMMAND)])
    assert found.signals["heading"].source == names[2]
    assert found.signals["heading"].unit == "rad"
    assert "pitch" not in found.signals


def test_theta_beside_a_heading_is_a_pitch() -> None:
    found = map_columns([log(heading=turned(COMMAND), theta=np.sin(TIME), fore_cmd=COMMAND)])
    assert found.signals["heading"].source == "heading"
    assert found.signals["pitch"].source == "theta"


@pytest.mark.parametrize(
    ("name", "factor", "unit"),
    [("yaw_rate", 1.0, "rad/s"), ("yaw_rate", 57.3, "deg/s"), ("r_dps", 1.0, "deg/s"), ("gyro_z_rad_s", 9.0, "rad/s")],
)
def test_a_yaw_rate_alone_is_measured(name: str, factor: float, unit: str) -> None:
    rate = 0.5 * np.gradient(np.unwrap(np.radians(turned(COMMAND))), TIME)
    rate *= factor / np.abs(rate).max()
    found = map_columns([log(**{name: rate, "fore_cmd": COMMAND})])
    assert found.measured.source == name
    assert (found.measured.unit, found.measured.is_rate) == (unit, True)
    assert not found.missing
    assert found.commands[0].direction == 1


def test_an_angular_rate_of_an_autopilot_is_no_sway() -> None:
    waves = log(**{name: np.sin(TIME) for name in ("RATE.YDes", "RATE.Y", "vel_y")})
    assert guess_planar([waves], {"vel_y"}, ()).signals == {}
    assert guess_planar([waves], set(), ()).signals["sway_velocity"].source == "vel_y"


@pytest.mark.parametrize(("axis", "name"), [("surge", "u_m_s"), ("sway", "sway_speed"), ("surge", "surge_vel [m/s]")])
def test_a_speed_without_a_position_is_measured(axis: str, name: str) -> None:
    speed = np.gradient(np.unwrap(np.radians(turned(COMMAND))), TIME)
    found = map_columns([log(**{name: speed, "fore_cmd": COMMAND})], GuessHints(axis=AXES[axis]))
    assert found.measured.source == name
    assert found.measured.is_rate
    assert not found.missing
