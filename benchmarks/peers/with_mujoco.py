"""Output error by mujoco.sysid: its least squares over roll-outs of a hinge."""

from __future__ import annotations

import contextlib
import sys

import mujoco
import numpy as np
from mujoco import sysid

from benchmarks.peers.log import HIGH, LOW, START, read, say

# A hinge's damping is a polynomial of the rate from MuJoCo 3.7 on.
MODEL = """
<mujoco>
  <option timestep="{step}" gravity="0 0 0" integrator="RK4"/>
  <worldbody>
    <body name="vehicle">
      <joint name="yaw" type="hinge" axis="0 0 1" damping="{linear} {quadratic}"/>
      <inertial pos="0 0 0" mass="1" diaginertia="{inertia} {inertia} {inertia}"/>
    </body>
  </worldbody>
  <actuator><motor name="torque" joint="yaw"/></actuator>
</mujoco>
"""


def set_inertia(spec: mujoco.MjSpec, parameter: sysid.Parameter) -> None:
    spec.body("vehicle").inertia = np.full(3, parameter.value[0])


def set_quadratic(spec: mujoco.MjSpec, parameter: sysid.Parameter) -> None:
    spec.joint("yaw").damping[1] = parameter.value[0]


def set_linear(spec: mujoco.MjSpec, parameter: sysid.Parameter) -> None:
    spec.joint("yaw").damping[0] = parameter.value[0]


def main() -> None:
    time, torque, heading = read()
    inertia, quadratic, linear = START
    step = float(np.median(np.diff(time)))
    spec = mujoco.MjSpec.from_string(MODEL.format(step=step, inertia=inertia, quadratic=quadratic, linear=linear))
    model = spec.compile()
    parameters = sysid.ParameterDict()
    modifiers = (set_inertia, set_quadratic, set_linear)
    for value, low, high, modifier in zip(START, LOW, HIGH, modifiers, strict=True):
        parameters.add(sysid.Parameter(modifier.__name__, value, low, high, modifier=modifier))
    # Evenly sampled: the simulation step equals the log's interval.
    sequence = sysid.ModelSequences(
        "yaw",
        spec,
        "log",
        sysid.create_initial_state(model, heading[:1], np.zeros(1)),
        sysid.TimeSeries(time, torque[:, None]),
        # The state itself: a sensor is one step late.
        sysid.TimeSeries.from_names(time, heading[:, None], model, [("yaw", sysid.SignalType.MjStateQPos)]),
        allow_missing_sensors=True,
    )
    residual = sysid.build_residual_fn(models_sequences=[sequence], resample_true=False)
    with contextlib.redirect_stdout(sys.stderr):
        found, _ = sysid.optimize(parameters, residual, verbose=False)
    say(found.as_vector())


if __name__ == "__main__":
    main()
