# %% [markdown]
# # From your own log to the next run
#
# A real dive of a BlueROV2 with an active autopilot, as a table with its own column names. rovid gets the DataFrame.

# %%
import pandas as pd

import rovid

folder = "sample_logs/bluerov2_pier59"
log = pd.read_csv(f"{folder}/dive.csv")
log.columns.tolist()

# %% [markdown]
# Say which column is which. A wrong name gives one message, which suggests a column.

# %%
curve = pd.read_csv(f"{folder}/t200_16V_curve.csv")
thrusters = [
    {"name": f"thruster_{n}", "yaw_arm": arm, "curve": curve, "command": f"pwm{n}_us"}
    for n, arm in {1: -0.167, 2: 0.167, 3: -0.167, 4: 0.167}.items()
]
try:
    rovid.Study.from_frame(log, signals={"time": "t_s", "heading": "headin_deg"}, thrusters=thrusters)
except rovid.RovidError as error:
    print(error)
rate = {"column": "yaw_rate_dps", "unit": "deg/s"}
study = rovid.Study.from_frame(
    log,
    signals={"time": "t_s", "heading": "heading_deg", "yaw_rate": rate},
    thrusters=thrusters,
    vehicle={"mass": 13.5, "length": 0.457, "width": 0.575},
)

# %% [markdown]
# Is the log good enough? Each numbered line is a task.

# %%
checked = study.check()
assert checked.verdict == "care"
checked

# %% [markdown]
# The parameters have wide intervals: a dive is no trial.

# %%
fit = study.fit()
inertia = fit.parameters["inertia"]
assert inertia.interval_95[0] < 2.5 < inertia.interval_95[1]  # kg m^2; another program's fit, see README.md of the log
fit.to_pandas()

# %%
study.simulate(fit).plot()

# %% [markdown]
# The run that narrows the inertia most, within five minutes and the commands of this log.

# %%
plan = study.plan(narrow="inertia", minutes=5.0)
plan.plot()
plan.to_pandas().head()
