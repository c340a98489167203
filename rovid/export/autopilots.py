"""ArduPilot and PX4: gains of the heading loop as parameters, and a vehicle for the JSON interface of ArduPilot's SITL.

Neither holds a model of the vehicle. ArduPilot's own simulated submarine has its inertia and drag in its source
(SIM_Submarine.cpp). Its JSON interface (libraries/SITL/examples/JSON) takes the motion from another program: there the
vehicle of `rovid.export.fossen` moves. The names of the parameters stand in the sources that
`rovid.control.actuators` cites.
"""

import math
from dataclasses import replace

from rovid.control.actuators import AUTOPILOTS, autopilot_loop, autopilot_parameters, default_gains
from rovid.control.control_law import ControllerOptions, loop_conditions
from rovid.core.errors import DataError, escape_invisible
from rovid.core.formatting import TextTemplates
from rovid.core.output_files import export_mark
from rovid.export import fossen
from rovid.export.interface import ExportInput, ExportResult
from rovid.export.rovid_equation import STEP, STEP_NOTE
from rovid.export.thruster_curves import constant_trim, number_list

_GAINS = (
    "The file holds gains. Inertia and drag of the vehicle are not among the autopilot's parameters; they act in the "
    "gains. Compare them with the ranges of your ground station before you load them."
)
_LOST = ("quadratic_drag", "linear_drag")
_TEXTS = TextTemplates(__file__, "ardupilot_sitl")


def export_ardupilot(subject: ExportInput) -> ExportResult:
    """Parameters of ArduSub, and as comments those of ArduRover."""
    lines, notes = _head("ardupilot", subject), [_GAINS]
    for name, mark in (("ardusub", ""), ("ardurover", "# ")):
        parameters, texts = _tuned(name, subject)
        lines += [f"# {AUTOPILOTS[name].title}. {text}" for text in texts]
        lines += [f"{mark}{key},{value:.10g}" for key, value in parameters.items()]
        notes += [f"{AUTOPILOTS[name].title}: {text}" for text in texts[:1]]
    notes.append("A vehicle for the JSON interface of SITL: rovid export ardupilot -o FILE.py.")
    return _gains_result(subject, lines, notes)


def export_px4(subject: ExportInput) -> ExportResult:
    """Parameters of the underwater vehicle's attitude control, as commands of PX4's shell."""
    parameters, texts = _tuned("px4", subject)
    lines = _head("px4", subject) + [f"# {text}" for text in texts]
    lines += [f"param set {key} {value:.10g}" for key, value in parameters.items()]
    texts.append("No integral: a constant torque without trim turns the vehicle by the torque over kp.")
    return _gains_result(subject, lines, [_GAINS, *texts])


def export_sitl(subject: ExportInput) -> ExportResult:
    """A program that moves the vehicle for ArduPilot's SITL."""
    made = fossen.export_module(subject)
    content = str(made.content).replace(export_mark("python-vehicle-simulator"), export_mark("ardupilot"))
    content = content.replace("\nimport math\n", "\nimport json\nimport math\nimport socket\nimport struct\n", 1)
    notes = (
        "Servo outputs 1 and up are the thrusters in the order of rovid.toml, 1100 to 1900 us over each curve's range.",
        "Yaw alone moves; the vehicle stays level at one place.",
    )
    return replace(made, content=content + _TEXTS["sitl"], notes=notes)


def _head(name: str, subject: ExportInput) -> list[str]:
    """Comments on the outputs and the trim."""
    vehicle = escape_invisible(subject.vehicle.name)
    lines = [f"# {export_mark(name)}.", f"# {vehicle}: yaw identified by rovid, positive clockwise from above."]
    for curve in subject.curves:
        ends = number_list(curve.command[[0, -1]])
        text = f"# {escape_invisible(curve.name)}: command at the ends {ends}, at rest {curve.neutral:.6g}, yaw arm "
        lines.append(f"{text}{curve.arm:.6g} m.")
    trim = constant_trim(subject.curves, subject.value("bias_torque", "torque"))
    return lines + [f"# Trim of {escape_invisible(one.thruster)}: {one.text}." for one in trim]


def _tuned(name: str, subject: ExportInput) -> tuple[dict[str, float], list[str]]:
    """Parameters of the autopilot ``name``, and sentences on the loop."""
    model, options = subject.model, ControllerOptions(law=name)
    conditions = loop_conditions(options, model, subject.heading_noise, subject.torque_in_use)
    try:
        law, loop, _ = autopilot_loop(
            model, subject.vehicle, conditions, AUTOPILOTS[name], default_gains(model, options.damping)
        )
    except DataError as error:
        return {}, [f"No gains: {error}"]
    margins = loop.margins()
    gains = (margins.gain_db, margins.gain_down_db)
    up, down = (f"{one:.1f} dB" if math.isfinite(one) else "without limit" for one in gains)
    text = f"Loop at {1.0 / law.period:g} Hz: phase margin {margins.phase_deg:.0f} deg, gain margin {up} up and {down} "
    text += f"down, delay margin {margins.delay_s:.2f} s, peak of the sensitivity {margins.sensitivity_peak:.2f}."
    words = f"An output of 1 is {law.full:.4g} N m, with every thruster at the end of its curve. "
    return autopilot_parameters(AUTOPILOTS[name], law), [text, f"{words}kp is {law.kp:.4g} N m/rad."]


def _gains_result(subject: ExportInput, lines: list[str], notes: list[str]) -> ExportResult:
    trimmed = {"bias_torque"} if constant_trim(subject.curves, subject.value("bias_torque", "torque")) else set()
    return ExportResult(
        content="\n".join(lines) + "\n",
        simulate=None,
        equation=subject.equation(STEP, **subject.drag_terms),
        kept_effects=frozenset(trimmed & subject.effects.keys()),
        base_losses=tuple((name, "the loop has no term for it: feedback takes its place") for name in _LOST),
        notes=(*notes, STEP_NOTE),
    )
