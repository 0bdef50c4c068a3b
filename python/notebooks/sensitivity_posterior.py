# %% [markdown]
# # Sensitivity and posterior
#
# Which parameters do the trials respond to, and what do they say about them? Carpus answers with its own methods; and
# since moments of thousands of parameter sets and their exact derivatives are cheap, any optimizer or sampler of
# Python can ask, too.

# %%
import numpy as np
import pandas as pd

import carpus

study = carpus.demo()
session = study.load()

# %% [markdown]
# ## Screening
#
# Morris' μ* of every property: how much the error changes, on average, when the parameter moves through its range.

# %%
sensitivity = study.sensitivity(starts=6).to_pandas()
sensitivity.pivot_table("mu_star", "property", "contraction").round(4)

# %% [markdown]
# ## Hundreds of sets at once
#
# An array (sets, muscles, 4) gives moments of all sets, on all cores.

# %%
rng = np.random.default_rng(1)
nominal = session.parameters
sets = np.repeat(nominal[None], 200, axis=0)
sets[:, :, :3] *= np.exp(0.03 * rng.standard_normal((200, 5, 3)))
batch = session.simulate(sets, use="train")
print(f"{len(sets)} sets × {len(batch.trials)} trials; array {batch.moment.shape}")
errors = batch.rmse().mean(axis=1)
print(f"RMSE of the sets: {errors.min():.3f} to {errors.max():.3f} N·m")

# %% [markdown]
# ## SciPy with the exact gradient
#
# `loss` is the mean squared error and its gradient. Factors of the parameters are their own natural scale, so we
# optimize logarithms.

# %%
from scipy.optimize import minimize


def scaled(x):
    p = nominal.copy()
    p[:, :3] *= np.exp(x.reshape(5, 3))
    return p


def error(x):
    p = scaled(x)
    value, gradient = session.loss(p)
    return value, (gradient[:, :3] * p[:, :3]).ravel()


# What the study's bounds allow: force, fibre length, slack length.
bounds = [b for _ in range(5) for b in np.log([(0.42, 2.514), (0.822, 1.178), (0.868, 1.132)])]
found = minimize(error, np.zeros(15), jac=True, bounds=bounds, method="L-BFGS-B", options={"maxiter": 40})
print(f"mean squared error {error(np.zeros(15))[0]:.4f} → {found.fun:.4f} (N·m)² in {found.nfev} evaluations")
held_out = [np.sqrt(session.loss(scaled(x), use="test")[0]) for x in (np.zeros(15), found.x)]
print(f"RMSE of held-out trials {held_out[0]:.3f} → {held_out[1]:.3f} N·m")

# %% [markdown]
# ## A posterior with an existing sampler
#
# emcee samples any density. Ours: independent Gaussian errors of the moment with the standard deviation that the fit
# left, and a Gaussian prior of 10 % for every logarithm. The samples of a trial are not independent: one in twenty
# counts. Walkers are evaluated as one batch.

# %%
import emcee

sigma2 = found.fun
effective = batch.moment.shape[1] / 20


def log_density(x):
    sets = np.repeat(nominal[None], len(x), axis=0)
    sets[:, :, :3] *= np.exp(x.reshape(-1, 5, 3))
    batch = session.simulate(sets, use="train")
    value = np.mean((batch.moment - batch.measured) ** 2, axis=1)
    inside = np.all((x > np.array(bounds)[:, 0]) & (x < np.array(bounds)[:, 1]), axis=1)
    return np.where(inside, -0.5 * effective * value / sigma2 - 0.5 * np.sum((x / 0.1) ** 2, axis=1), -np.inf)


walkers = np.clip(found.x, -0.08, 0.08) + 0.01 * rng.standard_normal((40, 15))
sampler = emcee.EnsembleSampler(40, 15, log_density, vectorize=True)
sampler.random_state = np.random.RandomState(1).get_state()
sampler.run_mcmc(walkers, 80)
sample = sampler.get_chain(discard=30, flat=True)
names = [f"{m}.{p}" for m in session.muscles for p in carpus.PARAMETERS[:3]]
own = pd.DataFrame(sample, columns=names)

# %% [markdown]
# ## Carpus' own posterior
#
# `identify` knows more: correlated noise of EMG and moment, the EMG behind the recorded one. Its intervals are the
# ones to report. Standard deviations of the logarithms beside each other:

# %%
identified = session.identify()
beside = pd.DataFrame({"emcee, independent noise": own.std(), "carpus": identified.draws.std()})
beside.sort_index().round(3)

# %%
identified.parameters[
    ["muscle", "property", "unit", "model", "most_likely", "interval_lower", "interval_upper", "share_from_data"]
].head(10)

# %% [markdown]
# The trial that would narrow them most:

# %%
pd.DataFrame(identified.next_trials).head(3)
