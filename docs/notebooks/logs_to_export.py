# %% [markdown]
# # From a folder of logs to a simulator
#
# The folder has a rovid.toml. `rovid init LOGS` writes a first one from your logs.

# %%
import rovid

study = rovid.open("sample_logs/rosub_hidden")
checked = study.check()
assert checked.verdict != "no_go"
checked

# %%
checked.plot()

# %%
diagnosis = study.diagnose()
diagnosis.to_pandas()

# %% [markdown]
# The run to make next, if the vehicle is still in the water.

# %%
plan = study.plan(effects=[cause.effect for cause in diagnosis.findings], minutes=5.0)
plan.plot()
plan.commands.head()

# %% [markdown]
# The model in Gazebo's format. rovid simulates the numbers of the file with Gazebo's equation and step, and lists what
# the format does not hold. `save` writes the file; nothing else here does.

# %%
exported = study.export("gz-sim", diagnosis)
print(exported)
path = exported.save("model.sdf")
