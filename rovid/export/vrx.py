"""VRX: SimpleHydrodynamics, whose drag and added mass are positive, in SDF.

From VRX's sources: the torque is -(nR + nRR*|r|)*r - nDotR*rdot, rdot of the step before, cropped at max_effort.
An added inertia as large as the body's makes that loop diverge, a smaller one lag: all of it is the link's.
"""

from __future__ import annotations

import numpy as np

from rovid.export.curves import curve_effect_keys, thruster_curves
from rovid.export.export_input import ExportInput
from rovid.export.export_result import ExportResult
from rovid.export.gz_sim import NEWTONS, deadband_thrust, frame_notes, gazebo_simulator, sdf

_STEP = 0.004  # s, of VRX's worlds
_EFFORT = 10.0  # times the largest drag in use; VRX crops at 10 kN m without


def export(subject: ExportInput) -> ExportResult:
    """A model in SDF for VRX on gz-sim."""
    model, propulsion = subject.model, thruster_curves(subject)
    bands = [deadband_thrust(subject, index) for index in range(len(propulsion))]
    effort = max(10_000.0, _EFFORT * float(model.drag(np.array(subject.largest_rate))))
    hydrodynamics = f"""    <plugin filename="libSimpleHydrodynamics.so" name="vrx::SimpleHydrodynamics">
      <link_name>base_link</link_name>
      <nDotR>0</nDotR>
      <nR>{model.linear_drag:.10g}</nR>
      <nRR>{model.quadratic_drag:.10g}</nRR>
      <max_effort>{effort:.10g}</max_effort>
    </plugin>"""

    def advance(rate: float, _: float, torque: float) -> float:
        drag = -(model.linear_drag + model.quadratic_drag * abs(rate)) * rate
        return rate + _STEP * (torque + min(max(drag, -effort), effort)) / model.inertia

    ratio = (
        "VRX takes the acceleration of the step before, which lags and, with an added inertia beyond the body's (here "
        f"{subject.added_inertia / subject.rigid_inertia:.2g} times it), diverges."
    )
    return ExportResult(
        content=sdf("vrx", subject, propulsion, bands, model.inertia, "", hydrodynamics),
        simulate=gazebo_simulator(propulsion, bands, advance, _STEP),
        kept_effects=curve_effect_keys(subject),
        notes=(
            *frame_notes(subject),
            NEWTONS,
            f"The whole inertia is the link's and <nDotR> 0: {ratio}",
            "What is not written keeps SimpleHydrodynamics' defaults, which are not zero (xU, yV 20): set your own.",
        ),
    )
