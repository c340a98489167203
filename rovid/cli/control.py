"""``rovid control``."""

from pathlib import Path
from typing import Annotated

from rovid.cli import context
from rovid.cli.options import EffectsFrom, ForceGuess, Json, OptionalLogs, ParameterFile, add_effects, option
from rovid.cli.streams import progress


def control(
    logs: OptionalLogs = None,
    *,
    kp: Annotated[float | None, option("GAIN", "Heading gain in N m/rad; requires --kd.")] = None,
    kd: Annotated[float | None, option("GAIN", "Yaw rate gain in N m s/rad; requires --kp.")] = None,
    damping: Annotated[float, option("RATIO", "Damping ratio, unless --kp and --kd are given.")] = 0.7,
    bandwidth: Annotated[
        float | None,
        option(
            "RAD/S",
            "Natural frequency in rad/s. Default: the largest one with a phase margin of 45 deg, a sensitivity "
            "peak of 1.6 and a delay margin of at least the delay of the loop, within the limits of noise and "
            "actuators.",
        ),
    ] = None,
    period: Annotated[float, option("S", "Sampling period of the controller in s.")] = 0.1,
    delay: Annotated[float, option("S", "Delay from heading to command in s.")] = 0.0,
    rate_filter: Annotated[
        float | None,
        option("S", "Time constant of the low-pass filter of the rate in s. Default: chosen by the design."),
    ] = None,
    law: Annotated[
        str,
        option(
            "NAME",
            "Control law: model, or the heading loop of an autopilot: ardusub, ardurover (PID on the yaw rate, with "
            "filters) or px4 (PD).",
        ),
    ] = "model",
    step: Annotated[
        list[str] | None, option("FROM:TO", "Simulate one more heading step, in deg, as 350:40. Repeatable.")
    ] = None,
    c: Annotated[Path | None, option("FILE", "Write the controller as C.")] = None,
    python: Annotated[Path | None, option("FILE", "Write the controller as Python.")] = None,
    parameters: ParameterFile = None,
    force: ForceGuess = False,
    effects_from: EffectsFrom = None,
    json: Json = False,
) -> None:
    """Design a heading controller."""
    add_effects(effects_from)
    from rovid.control.control_law import ControlLaw, c_source, python_source
    from rovid.control.design import design_controller
    from rovid.control.specs import ControllerOptions, loop_conditions
    from rovid.core.errors import ConfigError
    from rovid.core.output_files import C_SOURCE, PYTHON_SOURCE, OutputFile
    from rovid.present.console import show_caution, show_warnings
    from rovid.present.documents.results import control_document
    from rovid.present.terminal.diagnosis import show_control
    from rovid.trial.fault import fault_texts

    options = ControllerOptions(
        kp=kp,
        kd=kd,
        damping=damping,
        bandwidth=bandwidth,
        period=period,
        delay=delay,
        rate_filter=rate_filter,
        law=law,
        steps=tuple(step or ()),
    )
    if law != "model" and (c or python):
        raise ConfigError(f"is {law}; --c and --python write the model-aided law alone.", where="--law")
    stored = context.yaw_parameters(parameters)
    model = stored.model()
    paths = logs or context.stored_logs(stored)
    generators = {}
    for path, signature, source in ((c, C_SOURCE, c_source), (python, PYTHON_SOURCE, python_source)):
        if path is not None:
            generators[OutputFile(path, signature)] = source
    outputs = context.reserve_outputs(list(generators), paths, stored.path, force=force)
    study = context.open_logs(paths, None, stored.axis)
    study.vehicle.require_no_rudder("the controller")
    study.require_effects(model.effects)
    remarks, assumptions = context.require_usable(stored, study, force=force)
    conditions = loop_conditions(options, model, study.position_noise(), study.median_torque())
    with progress("Simulating the closed loop …"):
        result = design_controller(stored, study.vehicle, conditions, options)
    if generators and isinstance(result.law, ControlLaw):
        outputs.write({output: source(result.law, assumptions) for output, source in generators.items()})
    warnings = [*fault_texts(study.faults), *study.remarks(), *remarks]
    if json:
        context.print_json(control_document(result, warnings, assumptions))
    else:
        show_caution(context.console(), assumptions)
        show_control(context.console(), result, assumptions)
        show_warnings(context.console(), warnings)
