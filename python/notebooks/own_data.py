# %% [markdown]
# # Your own data from arrays
#
# A study needs no folder: a model, and for every trial time, angle, measured moment and the excitation of every
# muscle, as arrays or as columns of a data frame. Here the recordings are made from the bundled wrist with other
# muscle parameters, so that the truth is known; put your own in their place.

# %%
import numpy as np
import pandas as pd

import carpus

model = carpus.Model.bundled()
muscles = model.muscle_names
rng = np.random.default_rng(2026)
model

# %% [markdown]
# ## Trials
#
# Twelve trials of three seconds at 100 Hz: the wrist is held at an angle or swings slowly, and flexors or extensors
# pull harder and harder. The measured moment is not known yet: zero stands for it.

# %%
time = np.arange(0, 3, 0.01)


def recording(angle_deg, pull, strength):
    """A table as an acquisition program exports it."""
    swing = angle_deg if np.ndim(angle_deg) else np.full_like(time, angle_deg)
    table = pd.DataFrame({"time_s": time, "angle_deg": swing, "moment_n_m": 0.0})
    ramp = strength * np.clip(time - 0.5, 0, 2) / 2
    for muscle in muscles:
        works = muscle.startswith("F") == (pull == "flexion")
        table[muscle] = np.clip((ramp if works else 0.1 * ramp) + 0.02, 0, 1)
    return table


tables = {}
for pull in ["flexion", "extension"]:
    for angle in [-35, 0, 35]:
        tables[f"isometric_{pull}_{angle:+d}deg"] = (recording(angle, pull, 0.6), "isometric", pull)
    for i, strength in enumerate([0.4, 0.6, 0.5]):
        swing = 40 * np.sin(2 * np.pi * (0.4 + 0.1 * i) * time)
        tables[f"isotonic_{pull}_{i + 1}"] = (recording(swing, pull, strength), "isotonic", pull)

# %% [markdown]
# `Trial.from_frame` names the columns; every fourth trial is held out (`use="test"`). A study gets the checks that
# files get: a time that runs backwards, an EMG above 1, a moment of another length are errors that name the trial.


# %%
def study_of(tables):
    trials = [
        carpus.Trial.from_frame(
            name, table, muscles, contraction=contraction, direction=direction, use="test" if i % 4 == 3 else "train"
        )
        for i, (name, (table, contraction, direction)) in enumerate(tables.items())
    ]
    return carpus.Study.from_memory(
        model, trials, coordinate="flexion", muscles=muscles, posture={"elbow_flexion": 90.0}, name="my arrays"
    )


session = study_of(tables).load()
session

# %% [markdown]
# ## The person behind the recordings
#
# Parameters are one array, muscles × (force, fibre length, slack length, pennation). This person's flexors are
# stronger and all tendons a little longer than the model's. The moments come from the model with these parameters,
# with noise, and the EMG that the fit sees has an error of 5 %, too.

# %%
truth = session.parameters
truth[:, 0] *= [1.0, 1.2, 0.9, 1.4, 1.3]
truth[:, 1] *= [1.05, 1.0, 0.95, 1.0, 1.05]
truth[:, 2] *= [1.01, 1.02, 1.0, 1.015, 1.0]
moments = session.simulate(truth)
for name, (table, _, _) in tables.items():
    table["moment_n_m"] = moments[name][0] + 0.05 * rng.standard_normal(len(table))
    for muscle in muscles:
        table[muscle] = np.clip(table[muscle] * np.exp(0.05 * rng.standard_normal()), 0, 1)

# %% [markdown]
# ## Compare, personalize

# %%
session = study_of(tables).load()
before = session.compare()
fit = session.personalize()
fit.errors[["trials", "nrmse", "rmse_n_m", "pearson_r"]]

# %%
fit.plot()
# %% [markdown]
# The fitted forces beside the truth:

# %%
fitted = fit.parameters.xs("max_isometric_force", level="property")
pd.DataFrame(
    {
        "model": fitted["before"],
        "fitted": fitted["after"],
        "lower": fitted["interval_lower"],
        "upper": fitted["interval_upper"],
        "truth": pd.Series(truth[:, 0], index=session.muscles),
    }
).round(1)

# %% [markdown]
# Tables of a result are data frames: `fit.parameters.to_csv(…)` and `.to_parquet(…)` write them, `fit.write(…)` writes
# the folder of the command.
