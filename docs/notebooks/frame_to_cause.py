# %% [markdown]
# # From a DataFrame to a named cause
#
# Two logs of a simulated vehicle, in which a thruster lag and weak reverse thrust are hidden.

# %%
import pandas as pd

import rovid

folder = "sample_logs/rosub_hidden"
logs = {name: pd.read_csv(f"{folder}/{name}.csv") for name in ("sine_20s", "steps")}
frame = pd.concat(logs, names=["run"]).reset_index()
frame.head()

# %%
curve = pd.read_csv(f"{folder}/thrust_curve.csv")
study = rovid.Study.from_frame(
    frame,
    run="run",
    signals={"time": "time_s", "heading": "heading_deg"},
    thrusters=[{"name": n, "yaw_arm": 0.43, "curve": curve, "command": f"{n}_V"} for n in ("fore", "aft")],
)
study.check()

# %% [markdown]
# The plain model, inertia and drag alone, simulates the yaw rate with a visible error.

# %%
plain = study.fit()
plain.plot()

# %% [markdown]
# The diagnosis tests every effect of the catalogue on the error, and names the causes.

# %%
diagnosis = study.diagnose()
diagnosis

# %%
lag, reverse = diagnosis.findings
print(lag.parameters["time_constant"], "of 0.6 s;", reverse.parameters["reverse_gain"], "of 0.8")
lag.plot()

# %% [markdown]
# The model with both causes, against the same measurement, and on runs that were not fitted.

# %%
study.fit([cause.effect for cause in diagnosis.findings]).plot()
diagnosis.plot()
