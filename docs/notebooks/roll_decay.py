# %% [markdown]
# # Another axis: roll decays of a ship model
#
# Three real decays of a model of the tanker KVLCC2, heeled by hand and released. The model has no thrust.
# All parameters are therefore per kg m^2 of the inertia.

# %%
import rovid

study = rovid.open("sample_logs/kvlcc2_roll_decay", axis="roll")
study.check().plot()

# %%
fit = study.fit()
fit.to_pandas()

# %% [markdown]
# Natural period and damping ratio are in the document, as `rovid fit --axis roll --json` prints it. The period is known
# independently: 2.54 s.

# %%
period = fit.document["decay"]["natural_period"]
assert abs(period["value"] - 2.54) < 3.0 * period["standard_error"]
print(f"{period['value']:.3f} ± {period['standard_error']:.3f} s")

# %% [markdown]
# The simulation of each decay, from its first reading alone.

# %%
simulated = study.simulate(fit)
assert simulated.r2["roll_rate"] > 0.9
simulated.plot()
simulated.to_pandas()[["name", "roll_rate_r2"]]
