# %% [markdown]
# # Surge, sway and yaw together, to a simulator
#
# A simulated ROV with six thrusters in a current, with a compass and a DVL. `axes="planar"` fits one coupled model.

# %%
import rovid

study = rovid.open("sample_logs/planar_rov", axes="planar")
study.check()

# %% [markdown]
# The diagnosis takes a minute or two. It names the current, which heading and speeds over ground show together.

# %%
diagnosis = study.diagnose(budget=600.0)
(cause,) = diagnosis.findings
assert cause.effect == "current"
diagnosis

# %%
speed = cause.parameters["speed"]
assert abs(speed.value - 0.0826) < 4.0 * speed.standard_error  # m/s, the truth of the simulation
diagnosis.to_pandas()

# %% [markdown]
# The model with the current simulates all runs freely. R² of each measured speed:

# %%
simulated = study.simulate(diagnosis)
assert min(simulated.r2.values()) > 0.99
simulated.plot()
simulated.r2

# %% [markdown]
# The model as a function for the MSS toolbox in MATLAB, with the current. `not_held` lists what a format does not hold.

# %%
exported = study.export("mss", diagnosis)
assert exported.not_held == ()
exported
