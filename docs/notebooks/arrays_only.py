# %% [markdown]
# # Arrays alone, without a file
#
# A vehicle is simulated here. rovid gets the arrays of time, heading and command.

# %%
import numpy as np

import rovid

INERTIA, QUADRATIC, LINEAR, ARM = 400.0, 900.0, 60.0, 1.2  # kg m^2, N m s^2/rad^2, N m s/rad, m
STEP, EVERY = 0.005, 20  # s, steps in a sample

draw = np.random.default_rng(7)
time = STEP * np.arange(48_000)
volts = np.repeat(draw.choice([-4.0, -2.0, 0.0, 2.0, 4.0], 24), 2000)  # a new level every 10 s
volts[16_000:32_000] = 4.0 * np.sin(2.0 * np.pi * time[16_000:32_000] / 20.0)
volts = np.repeat(volts[::EVERY], EVERY)  # the command holds for one sample


# %%
def simulate(lag: float) -> np.ndarray:
    """Heading in rad of the vehicle, whose thrust follows the command with this lag in s, with noise."""
    heading, rate, thrust, headings = 0.0, 0.0, 0.0, []
    for volt in volts:
        headings.append(heading)
        acting = thrust if lag else 50.0 * volt
        thrust += STEP * (50.0 * volt - thrust) / lag if lag else 0.0
        heading += STEP * rate
        rate += STEP * (ARM * acting - QUADRATIC * abs(rate) * rate - LINEAR * rate) / INERTIA
    return np.array(headings[::EVERY]) + draw.normal(0.0, 2e-4, len(headings[::EVERY]))


def study_of(heading: np.ndarray) -> rovid.Study:
    """The study of these arrays."""
    return rovid.Study.from_frame(
        {"t": time[::EVERY], "psi": heading, "volts": volts[::EVERY]},
        signals={"time": "t", "heading": {"column": "psi", "unit": "rad"}},
        thrusters=[{"name": "stern", "yaw_arm": ARM, "curve": ([-5.0, 5.0], [-250.0, 250.0]), "command": "volts"}],
        vehicle={"mass": 900.0, "length": 2.2, "width": 0.8},
    )


# %%
free = study_of(simulate(0.0))
fit = free.fit()
for name, truth in {"inertia": INERTIA, "quadratic_drag": QUADRATIC, "linear_drag": LINEAR}.items():
    value = fit.parameters[name]
    assert abs(value.value - truth) < 4.0 * value.standard_error, name
fit

# %% [markdown]
# With a lag of 0.4 s the plain model fails. The diagnosis names the lag, and its size.

# %%
diagnosis = study_of(simulate(0.4)).diagnose(budget=600.0)
(cause,) = diagnosis.findings
assert cause.effect == "thruster_lag", diagnosis
assert abs(cause.parameters["time_constant"].value - 0.4) < 0.01
cause.to_pandas()
