"""Control law, and its source in C and Python."""

from __future__ import annotations

import ctypes
import math
import re
import subprocess
from typing import Any

import numpy as np
import pytest

from rovid.control.control_law import ControlLaw, c_source, python_source, static_terms_of, wrapped
from rovid.trial.assumptions import Assumptions
from tests.control.loops import closed, law, with_effect


@pytest.fixture(scope="module")
def generated(tmp_path_factory: pytest.TempPathFactory) -> tuple[ControlLaw, Any, Any]:
    controller = law(
        900.0, 3000.0, inertia=5057.0, static_terms=(1.5, -0.3, 0.01, 2.0, -1.0, 0.7, 0.2), lowest=-400.0, highest=500.0
    )
    folder = tmp_path_factory.mktemp("source")
    (folder / "c.c").write_text(c_source(controller, Assumptions()))
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-ffp-contract=off", "-shared", "-fPIC"]
    subprocess.run(["cc", *flags, "-o", folder / "c.so", folder / "c.c", "-lm"], check=True)
    module: dict[str, Any] = {}
    exec(compile(python_source(controller, Assumptions()), "controller.py", "exec"), module)  # noqa: S102 - what is under test
    return controller, ctypes.CDLL(str(folder / "c.so")), module


def test_generated_sources_equal_the_simulated_controller(generated: tuple[ControlLaw, Any, Any]) -> None:
    controller, library, module = generated
    library.rovid_control_step.restype = ctypes.c_double
    step_in_c = library.rovid_control_step
    step_in_c.argtypes = [ctypes.c_void_p, *[ctypes.c_double] * 4]
    library.rovid_control_start.argtypes = [ctypes.c_void_p, ctypes.c_double]
    rng = np.random.default_rng(5)
    headings = np.cumsum(rng.normal(0.0, 0.02, 3000)) + 3.0
    headings = np.where(rng.random(3000) < 0.5, headings, headings % (2.0 * math.pi))  # wrapped or not
    memory = (ctypes.c_double * 3)()
    library.rovid_control_start(memory, headings[0])
    state, plain = controller.initial_state(headings[0]), module["Controller"](headings[0])
    torques = []
    for k, heading in enumerate(headings):
        wanted, rate, acceleration = math.sin(0.01 * k) * 3.0, 0.01 * math.cos(0.01 * k), 1e-3 * math.sin(0.02 * k)
        torque, state = controller.step(state, heading, wanted, rate, acceleration)
        in_c = step_in_c(memory, heading, wanted, rate, acceleration)
        in_python = plain.step(heading, wanted, rate, acceleration)
        # Sums in another order, of thousands of N m.
        assert in_c == pytest.approx(torque, abs=1e-9)
        assert in_python == pytest.approx(torque, abs=1e-9)
        torques.append(torque)
    assert min(torques) == -400.0
    assert max(torques) == 500.0
    assert np.ptp(torques) > 100.0


def test_sources_with_guessed_values_carry_a_notice() -> None:
    controller = law(900.0, 3000.0, inertia=5057.0)
    guess = Assumptions(items=("yaw_arm of */ fore",), thrusters=1)
    for source in (c_source, python_source):
        (head,) = re.findall(r"Written by rovid .*", source(controller, guess))
        assert head.endswith("PLACEHOLDERS: arms or thrust curves are guesses.")
        assert "PLACEHOLDERS" not in source(controller, Assumptions())


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("bias_torque", (8.0,)),
        ("tether_torsion", (2.0,)),
        ("tether_torsion:stiffening", (2.0, 6.0)),
        ("heading_dependent_torque:mixed", (6.0, 0.4, 3.0, -1.0)),
    ],
)
def test_torques_at_rest_are_compensated(key: str, values: tuple[float, ...]) -> None:
    model = with_effect(key, *values)
    known = law(900.0, 3000.0, static_terms=static_terms_of(model))
    unknown = law(900.0, 3000.0)
    errors = [
        abs(math.degrees(wrapped(c.setpoint[-1] - c.heading[-1])))
        for c in (closed(model, known), closed(model, unknown))
    ]
    assert errors[0] < 1e-3
    assert errors[1] > 0.05
