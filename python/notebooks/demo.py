# %% [markdown]
# # The demo
#
# The bundled study has one participant with 28 trials: a wrist pulls and pushes against a dynamometer while EMG of
# five muscles is recorded. OpenSim 4.6 simulated the trials, with 10 % EMG noise and with muscle parameters that
# Carpus is not given. Six lines fit them and ask which physics is missing; no file is touched.

# %%
import carpus

study = carpus.demo()
session = study.load("P01")
fit = session.personalize()
diagnosis = session.diagnose()
print(fit.errors["nrmse"].unstack("model").round(4), diagnosis, sep="\n\n")

# %% [markdown]
# The error of the nine held-out trials, which no fit saw, falls to less than half. A result shows itself: errors of
# the model before and after, and the moments of held-out trials.

# %%
fit

# %%
fit.plot()
# %% [markdown]
# ## Which values were fitted, and how well they are known
#
# `share_from_data` says how much of what is known of a value comes from the trials; the rest is what the bounds say.

# %%
fit.parameters[["unit", "before", "after", "interval_lower", "interval_upper", "share_from_data"]].round(4)

# %% [markdown]
# ## Is something missing?
#
# The trials were simulated with the model's own physics. The diagnosis says so: nothing is detectable beyond muscle
# parameters and noise. The table ranks what was considered.

# %%
print(diagnosis.verdict)
diagnosis.candidates.head(5)

# %% [markdown]
# ## The files of the command
#
# `write` makes the files that `carpus personalize` makes, byte for byte: `model.osim` (your model with the fitted
# values), `results.json`, `report.html`, tables and series. The model can also be used at once.

# %%
fit.model.muscles.to_pandas()[["max_isometric_force", "optimal_fiber_length", "tendon_slack_length"]]
