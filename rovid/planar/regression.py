"""Regression of inverse dynamics on smoothed motion: inertias, drags, and lifts of rudders."""

import math
from collections.abc import Sequence

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray
from rovid.planar.dataset import SmoothRun
from rovid.planar.model import BASE_COUNT, INPUT_COUNT, RUDDER_INPUTS, RudderModel


def regression(
    rows: SmoothRun, axes: BoolArray, rudders: tuple[RudderModel, ...], slipstreams: FloatArray, mass: float = 0.0
) -> tuple[float, FloatArray]:
    """Share of the variance left, and (10 + rudders,) base parameters and lifts, by bounded least squares.

    ``mass``: Least inertia of surge and sway.

    One equation after the other, each with what the equations before it gave: an axis without an actuator, as sway
    often is, takes its scale from the centripetal force of surge. Fossen 2011, equation 6.57.
    """
    u, v, r = rows.speeds.T
    du, dv, dr = rows.accelerations.T
    forces = rows.inputs[:, :INPUT_COUNT]
    units = [unit_rudder_forces(rudder, float(slipstreams[at]), rows, at) for at, rudder in enumerate(rudders)]
    values = np.zeros(BASE_COUNT + len(rudders))
    values[BASE_COUNT:] = [rudder.lift for rudder in rudders]
    left = []
    if axes[0]:
        # The inertia and damping of surge; what the sway and the turn add is left to its own coefficients.
        columns = [du, u, np.abs(u) * u, -v * r, -r * r, *[-unit[:, 0] for unit in units]]
        found, share = _bounded(columns, forces[:, 0], (3, 4), mass)
        values[[0, 4, 7]] = found[:3]
        left.append(share)
    if axes[1]:
        columns = [dv, v, np.abs(v) * v, dr, *[-unit[:, 1] for unit in units]]
        found, share = _bounded(columns, forces[:, 1] - values[0] * u * r, (3,), mass)
        values[[1, 5, 8, 3]] = found[:4]
        if not forces[:, 2].any():
            values[BASE_COUNT:] = np.where(values[BASE_COUNT:] > 0.0, values[BASE_COUNT:], found[4:])
        left.append(share)
    munk = (values[0] - values[1]) * u * v - values[3] * (dv + u * r)
    known = sum((lift * unit[:, 2] for lift, unit in zip(values[BASE_COUNT:], units, strict=True)), np.zeros(len(u)))
    columns = [dr, r, np.abs(r) * r]
    if forces[:, 2].any():
        columns += [-unit[:, 2] for unit in units]
        known = np.zeros(len(u))
    found, share = _bounded(columns, forces[:, 2] + munk + known, ())
    values[[2, 6, 9]] = found[:3]
    if len(found) > 3:
        values[BASE_COUNT:] = found[3:]
    left.append(share)
    return float(np.mean(left)), values


def _bounded(
    columns: Sequence[FloatArray], target: FloatArray, free: tuple[int, ...], least: float = 0.0
) -> tuple[FloatArray, float]:
    """Coefficients of 0 or more, ``free`` ones of either sign, and the share of the target's power that is left.

    The first coefficient is the ``least`` one or more.
    """
    from scipy.optimize import nnls  # The import takes long.

    matrix = np.column_stack(columns)
    scale = np.sqrt(np.mean(matrix**2, axis=0))
    used = np.flatnonzero(scale > 1e-12 * max(float(scale.max()), 1e-300))
    values, power = np.zeros(len(scale)), float(target @ target)
    if not power > 0.0 or not used.size:
        return values, 1.0
    size = math.sqrt(power / len(target))
    # Triangular equations with the free coefficients first: the others do not depend on them.
    is_free = np.isin(used, free)
    used, count = np.concatenate((used[is_free], used[~is_free])), int(is_free.sum())
    root = np.asarray(
        np.linalg.qr(np.column_stack((matrix[:, used] / scale[used], (target - least * columns[0]) / size)), mode="r")
    )
    signed, left = nnls(root[count:, count:-1], root[count:, -1]) if count < len(used) else (np.zeros(0), root[-1, -1])
    above = root[:count, -1] - root[:count, count:-1] @ signed
    either = np.linalg.lstsq(root[:count, :count], above, rcond=None)[0]
    values[used] = np.concatenate((either, signed)) * size / scale[used]
    values[0] += least
    return values, float(left) ** 2 * size**2 / power


def unit_rudder_forces(rudder: RudderModel, slipstream: float, rows: SmoothRun, number: int) -> FloatArray:
    """(g, 3) forces of a rudder with a lift of 1; as `rovid.planar.equations.forces`."""
    u, v, r = rows.speeds.T
    angle, thrust = rows.inputs[:, INPUT_COUNT + RUDDER_INPUTS * number :][:, :RUDDER_INPUTS].T
    x, y = rudder.position
    along, across = u - y * r, v + x * r
    ahead = along * np.abs(along) + slipstream * np.maximum(thrust, 0.0)
    attack = np.sign(ahead) * angle + np.arctan2(across, np.sqrt(np.abs(ahead)))
    normal = (np.abs(ahead) + across**2) * np.sin(np.clip(attack, -rudder.stall, rudder.stall))
    fx, fy = -normal * np.sin(angle), -normal * np.cos(angle)
    return np.column_stack((fx, fy, x * fy - y * fx))
