"""What is true of a campaign: parameters by the contract's names, the hidden cause, what the logs determine."""

from __future__ import annotations

from typing import Any

import numpy as np

from tools.planar.campaign import Campaign, current_at, hull_of, simulated
from tools.planar.motion import Floats, Hull

BASE = {
    "surge.inertia": "surge_inertia", "sway.inertia": "sway_inertia", "yaw.inertia": "yaw_inertia",
    "sway_yaw.inertia": "sway_yaw_inertia", "surge.linear_drag": "surge_linear",
    "surge.quadratic_drag": "surge_quadratic", "sway.linear_drag": "sway_linear",
    "sway.quadratic_drag": "sway_quadratic", "yaw.linear_drag": "yaw_linear", "yaw.quadratic_drag": "yaw_quadratic",
}  # fmt: skip
_THIN = 400  # readings of a sensor in a run that the sensitivities use


def truth_of(campaign: Campaign) -> dict[str, Any]:
    """True values of the campaign, for JSON."""
    vehicle, cause = campaign.vehicle, campaign.cause
    hull = hull_of(campaign)
    # In these families the base model of docs/planar.md is exact but for the disturbance and the cause.
    exact = vehicle.ship.length == 0.0 and vehicle.family != "auv_rudder"
    # With a cause that no form of the catalogue describes, no parameter has to be right.
    comparable = exact and (cause is None or cause.in_catalogue)
    values = {name: float(getattr(hull, attribute)) for name, attribute in BASE.items()}
    # The strips' drag in pure sway and in pure yaw is part of the quadratic drags.
    values["sway.quadratic_drag"] += hull.strip * hull.strip_length
    values["yaw.quadratic_drag"] += hull.strip * hull.strip_length**4 / 32.0
    errors = relative_errors(campaign) if vehicle.ship.length == 0.0 else {}
    return {
        "seed": campaign.seed, "index": campaign.index, "family": vehicle.family, "length": vehicle.length,
        "time_constants": list(vehicle.time_constants), "full_speeds": list(vehicle.full), "base_exact": exact,
        "parameters": values if vehicle.ship.length == 0.0 else {},
        "comparable": list(values) if comparable else [],
        "hidden": cause.effect if cause else None, "form": cause.form if cause else None,
        "hidden_parameters": dict(cause.parameters) if cause else {}, "thruster": cause.thruster if cause else "",
        "hull_changes": dict(cause.hull) if cause else {},
        "current": {"speed": cause.current, "direction": cause.direction, "memory": cause.memory} if cause else {},
        "visibility_percent": campaign.changed, "predicted_relative_errors": errors,
        "determined": [name for name, error in errors.items() if error < 0.3],
        "undetermined": [name for name, error in errors.items() if error > 1.0],
        "sensors": [{"kind": one.kind, "rate": one.rate, "noise": one.noise, "latency": one.latency,
                     "gaps": one.gaps, "outliers": one.outliers} for one in campaign.sensors],
        "format": campaign.format, "clock": campaign.clock, "command_hz": campaign.command_hz,
        "disturbance": list(campaign.disturbance), "memory": campaign.memory, "waves": campaign.waves,
        "runs": [{"kind": run.kind, "length": run.length, "pilot": run.pilot.kind} for run in campaign.runs],
    }  # fmt: skip


def _outputs(campaign: Campaign) -> list[list[Floats]]:
    """Clean readings of each run and sensor, as (m, signals); of heading and position the changes."""
    result = []
    longest = max(campaign.vehicle.time_constants)
    for run in campaign.runs:
        each = []
        for k, sensor in enumerate(campaign.sensors):
            state, flow = run.truth[k], current_at(campaign, run, k)
            psi = state[:, 2]
            surge = state[:, 3] + np.cos(psi) * flow[:, 0] + np.sin(psi) * flow[:, 1]
            sway = state[:, 4] - np.sin(psi) * flow[:, 0] + np.cos(psi) * flow[:, 1]
            columns: dict[str, Floats] = {
                "heading": psi, "yaw_rate": state[:, 5], "north": state[:, 0], "east": state[:, 1],
                "surge_velocity": surge, "sway_velocity": sway,
            }  # fmt: skip
            lag = max(round(longest * sensor.rate), 1)
            columns |= {
                name: columns[name][lag:] - columns[name][:-lag]
                for name in ("heading", "north", "east") if psi.size > lag
            }  # fmt: skip
            thin = max(psi.size // _THIN, 1)
            each.append(np.column_stack([columns[name] for name in sensor.signals])[::thin])
        result.append(each)
    return result


def relative_errors(campaign: Campaign) -> dict[str, float]:
    """Predicted standard error over value for each base parameter, from free-running sensitivities of this simulator.

    A rough bound for the rank test. Heading and position count by their change over a longest time constant. What the
    disturbance makes of them is noise, the same over its memory. Each run's initial state is unknown. The sway-yaw
    inertia is compared with the largest that it could be, and drags with the whole drag of their axis at half speed.
    """
    hull = hull_of(campaign)
    base = _outputs(simulated(campaign, replay=True, still=True))
    real = _outputs(campaign)
    scales = _scales(campaign, hull)
    moved = []
    for name, attribute in BASE.items():
        shifted = hull._replace(**{attribute: getattr(hull, attribute) + 1e-3 * scales[name]})
        moved.append((_outputs(simulated(campaign, hull=shifted, replay=True, still=True)), 1e-3))
    speed, longest = campaign.vehicle.full, max(campaign.vehicle.time_constants)
    sizes = np.array([speed[0] * longest, speed[0] * longest, 0.3, *speed]) * 1e-3
    starts = [
        (_outputs(simulated(campaign, replay=True, still=True, offsets=size * np.eye(6)[k])), 1e-3)
        for k, size in enumerate(sizes.tolist())
    ]
    information = np.zeros((len(BASE), len(BASE)))
    for i in range(len(campaign.runs)):
        rows, nuisance = [], []
        for k, sensor in enumerate(campaign.sensors):
            away = real[i][k] - base[i][k]
            if away.shape[0] < 2:
                continue
            # Readings in a memory of the disturbance, which count as one.
            alike = max((campaign.memory + longest) * away.shape[0] / campaign.runs[i].length, 1.0)
            noise = np.sqrt(2.0 * sensor.noise**2 + alike * np.var(away, axis=0))
            rows.append(np.array([((one[i][k] - base[i][k]) / step / noise).ravel() for one, step in moved]).T)
            nuisance.append(np.array([((one[i][k] - base[i][k]) / step / noise).ravel() for one, step in starts]).T)
        s, n = np.vstack(rows), np.vstack(nuisance)
        left, values, _ = np.linalg.svd(n, full_matrices=False)
        left = left[:, values > 1e-8 * values[0]]
        s = s - left @ (left.T @ s)
        information += s.T @ s
    covariance = np.linalg.inv(information + 1e-12 * np.eye(len(BASE)))
    return {name: float(np.sqrt(covariance[k, k])) for k, name in enumerate(BASE)}


def _scales(campaign: Campaign, hull: Hull) -> dict[str, float]:
    """Size of each base parameter that a relative error refers to."""
    u, v, r = (0.5 * one for one in campaign.vehicle.full)
    scales = {name: float(getattr(hull, attribute)) for name, attribute in BASE.items()}
    scales["sway_yaw.inertia"] = float(np.sqrt(hull.sway_inertia * hull.yaw_inertia))
    for axis, speed in (("surge", u), ("sway", v), ("yaw", r)):
        linear, quadratic = scales[f"{axis}.linear_drag"], scales[f"{axis}.quadratic_drag"]
        scales[f"{axis}.linear_drag"] = linear + quadratic * speed
        scales[f"{axis}.quadratic_drag"] = linear / speed + quadratic
    return scales
