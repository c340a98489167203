"""What is true of a campaign, and how far its hidden cause shows."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from tools.wide.campaign import VISIBLE, Campaign, rate_change, simulated
from tools.wide.causes import ALL
from tools.wide.motion import Floats

visibility = rate_change


def _rates(campaign: Campaign) -> Floats:
    """Yaw rates (m,) of all runs, as the compass shows them, in rad/s."""
    parts = []
    for run in campaign.runs:
        rate = run.truth[:, 1].copy()
        if campaign.cause:
            psi, cause = run.truth[:, 0], campaign.cause
            rate *= 1.0 + cause.once * np.cos(psi + cause.once_phase)
            rate += run.truth[:, 1] * 2.0 * cause.twice * np.cos(2.0 * psi + cause.twice_phase)
        parts.append(rate)
    return np.concatenate(parts)


def after_refit(campaign: Campaign) -> dict[str, float]:
    """How far the cause shows once inertia and drags were fitted without it.

    The fit knows the disturbance; only the cause is missing.

    Returns
    -------
    dict
        ``left``: root mean square of what is left of the yaw rate, over that of the rate. ``disturbed``: the same of
        the change that the disturbance makes. ``evidence``: gain in log-likelihood in nats that the true cause has
        over the plain model on average, for a linear vehicle with the true disturbance and noise.
    """
    wanted = _rates(campaign)
    size = math.sqrt(float(np.mean(wanted**2)))
    logs = np.log([campaign.plain.inertia, campaign.plain.quadratic, campaign.plain.linear + 1e-9])
    weights = [whitening(campaign, run.time.size) for run in campaign.runs]
    edges = np.cumsum([run.time.size for run in campaign.runs])[:-1]

    def rest(values: Floats) -> Floats:
        inertia, quadratic, linear = np.exp(np.minimum(values, 60.0)).tolist()
        physics = campaign.plain._replace(inertia=inertia, quadratic=quadratic, linear=linear)
        found: Floats = wanted - _plain_rates(simulated(campaign, physics, replay=True))
        return found

    def whitened(values: Floats) -> Floats:
        parts = zip(np.split(rest(values), edges), weights, strict=True)
        return np.concatenate([np.fft.irfft(np.fft.rfft(part) * weight, part.size) for part, weight in parts])

    logs, left = _least(rest, logs)
    _, white = _least(whitened, logs)
    plain = _plain_rates(simulated(campaign, campaign.plain, replay=True))
    calm = np.concatenate(_without_disturbance(campaign))
    return {
        "left": math.sqrt(float(np.mean(left**2))) / size,
        "disturbed": math.sqrt(float(np.mean((plain - calm) ** 2))) / math.sqrt(float(np.mean(plain**2))),
        "evidence": 0.5 * float(white @ white),
    }


def _least(residual: Callable[[Floats], Floats], start: Floats) -> tuple[Floats, Floats]:
    """Values (3,) and residuals of a damped Gauss-Newton fit."""
    values, now = start, residual(start)
    damping = 1e-3
    for _ in range(6):
        slopes = np.column_stack([(residual(values + 0.01 * step) - now) / 0.01 for step in np.eye(3)])
        normal = slopes.T @ slopes
        change = np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-30), -slopes.T @ now)
        trial = values + np.clip(change, -1.0, 1.0)
        after = residual(trial)
        if not np.all(np.isfinite(after)) or after @ after > now @ now:
            damping *= 30.0
            continue
        done = now @ now - after @ after < 1e-4 * (now @ now)
        values, now = trial, after
        if done:
            break
    return values, now


def whitening(campaign: Campaign, count: int) -> Floats:
    """Factors for the Fourier transform of a residual of the rate (count,) that make unit noise of it.

    Noise of the rate is what the disturbance makes on a vehicle with the drag at the usual rate, and the noise of the
    heading (with its rounding) and of the gyro.
    """
    vehicle, step = campaign.vehicle, 1.0 / campaign.heading_hz
    omega = 2.0 * np.pi * np.fft.rfftfreq(count, step)
    usual = math.sqrt(float(np.mean(_plain_rates(campaign) ** 2)))
    drag = 2.0 * vehicle.quadratic_drag * usual + vehicle.linear_drag
    torque = 2.0 * campaign.disturbance**2 * campaign.memory / (1.0 + (omega * campaign.memory) ** 2)
    heading = omega**2 * campaign.noise**2 * step
    if campaign.rate_noise:
        gyro = campaign.rate_noise**2 * step
        heading = heading * gyro / (heading + gyro)
    density = torque / ((vehicle.inertia * omega) ** 2 + drag**2) + heading
    factors: Floats = np.sqrt(step / density)
    return factors


def _plain_rates(campaign: Campaign) -> Floats:
    return np.concatenate([run.truth[:, 1] for run in campaign.runs])


def _without_disturbance(campaign: Campaign) -> list[Floats]:
    """Rates (m,) of each run of the plain vehicle without a disturbance."""
    runs = []
    for run in campaign.runs:
        series = run.series.copy()
        series[:, 0] = 0.0
        runs.append(replace(run, series=series))
    still = simulated(replace(campaign, runs=tuple(runs)), campaign.plain, replay=True)
    return [run.truth[:, 1] for run in still.runs]


def truth_of(campaign: Campaign, *, refit: bool = False) -> dict[str, Any]:
    """What is true of a campaign, for JSON. ``refit``: with `after_refit`, which takes longer."""
    vehicle, cause = campaign.vehicle, campaign.cause
    shown = rate_change(campaign)
    sizes: dict[str, Any] = {}
    if cause:
        sizes = {name: value for name, value in asdict(cause).items() if isinstance(value, float) and value}
        sizes = {name: value for name, value in sizes.items() if name != "strength" and math.isfinite(value)}
        sizes |= dict(cause.physics)
    return {
        "seed": campaign.seed,
        "index": campaign.index,
        "effect": cause.effect if cause else None,
        "form": cause.form if cause else None,
        "strength": cause.strength if cause else None,
        "parameters": dict(cause.parameters) if cause else {},
        "sizes": sizes,
        "weak_thruster": cause.weak_name if cause else "",
        "inertia": vehicle.inertia,
        "quadratic_drag": vehicle.quadratic_drag,
        "linear_drag": vehicle.linear_drag,
        "comparable": list(cause.comparable if cause else ALL),
        "visibility": shown,
        "visible": shown >= VISIBLE,
        "time_constant": vehicle.time_constant,
        "full_rate": vehicle.full_rate,
        "torque": vehicle.torque,
        "quadratic_share": vehicle.quadratic_drag * vehicle.full_rate**2 / vehicle.torque,
        "rigid_inertia": vehicle.rigid_inertia,
        "unit": vehicle.unit,
        "shape": vehicle.shape,
        "thrusters": len(vehicle.names),
        "heading_hz": campaign.heading_hz,
        "command_hz": campaign.command_hz,
        "format": campaign.format,
        "clock": campaign.clock,
        "noise_deg": math.degrees(campaign.noise),
        "rate_logged": campaign.rate_noise > 0.0,
        "speed_logged": campaign.speed > 0.0,
        "voltage_logged": campaign.voltage > 0.0,
        "disturbance": campaign.disturbance,
        "scale": campaign.scale,
        "runs": [{"kind": run.kind, "start": run.start, "seconds": float(run.time[-1])} for run in campaign.runs],
        "samples": sum(run.time.size for run in campaign.runs),
        **(after_refit(campaign) if refit else {}),
    }
