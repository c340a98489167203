"""``rovid control``."""

from pathlib import Path

from rovid.cli import context
from rovid.cli.options import add_effects
from rovid.cli.streams import progress


def control(
    logs: list[Path] | None = None,
    *,
    kp: float | None = None,
    kd: float | None = None,
    damping: float = 0.7,
    bandwidth: float | None = None,
    period: float = 0.1,
    delay: float = 0.0,
    rate_filter: float | None = None,
    law: str = "model",
    step: list[str] | None = None,
    c: Path | None = None,
    python: Path | None = None,
    parameters: Path | None = None,
    force: bool = False,
    effects_from: list[Path] | None = None,
    json: bool = False,
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
