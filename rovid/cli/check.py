"""``rovid check``."""

from collections.abc import Mapping

from rovid.cli.context import announce_compilation, console, named_axis, print_json
from rovid.cli.options import Axes, AxisName, Json, Logs
from rovid.cli.planar_session import is_planar
from rovid.core.errors import DataError


def check(logs: Logs, *, axis: AxisName = None, axes: Axes = None, json: Json = False) -> None:
    """Check the logs and list their content and problems."""
    if is_planar(axes, axis):
        _check_planar(logs, json=json)
        return
    from rovid.preflight.check import check_logs
    from rovid.present.console import show_caution
    from rovid.present.documents.results import check_document
    from rovid.present.terminal.check import show_check
    from rovid.trial.config import find_config, load_config

    announce_compilation()
    config = load_config(find_config(logs), named_axis(axis))
    checked = check_logs(logs, config)
    if json:
        print_json(check_document(checked, config.vehicle))
    else:
        show_caution(console(), config.vehicle.assumptions)
        show_check(console(), checked)
    _refuse_problems(checked.problems, len(checked.rows))


def _check_planar(logs: Logs, *, json: bool) -> None:
    """Check the logs for surge, sway and yaw together."""
    from rovid.preflight.planar_check import check_planar
    from rovid.present.console import show_caution
    from rovid.present.documents.planar import planar_check_document
    from rovid.present.terminal.planar import show_planar_check
    from rovid.store.planar_prior import planar_prior
    from rovid.trial.config import find_config, load_planar_config

    config = load_planar_config(find_config(logs))
    planar_prior(config)  # A wrong prior is refused before the fit.
    checked = check_planar(logs, config)
    if json:
        print_json(planar_check_document(checked, config.vehicle))
    else:
        show_caution(console(), config.vehicle.assumptions)
        show_planar_check(console(), checked)
    _refuse_problems(checked.problems, len(checked.trials))


def _refuse_problems(problems: Mapping[str, str], usable: int) -> None:
    """Raise `DataError` for logs that cannot be used, with the number of the others."""
    if problems:
        name, problem = next(iter(problems.items()))
        bad = len(problems)
        lead = f"{bad} of {bad + usable} logs cannot be used. " if name in problem else f"{name}: "
        raise DataError(f"{lead}{problem}")
