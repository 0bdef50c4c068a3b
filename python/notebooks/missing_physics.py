# %% [markdown]
# # Which physics is missing
#
# The bundled trials follow the model's own physics. Here the dynamometer's moment gets what the model has not: dry
# friction of the joint. A diagnosis of the changed trials should find it among 36 effects, and a model with it should
# predict trials that it has not seen.

# %%
import numpy as np

import carpus

clean = carpus.demo().load()
about = clean.trials()


def with_friction(size):
    """The bundled trials with a friction of that size [N·m]."""
    trials = []
    for name in clean.trial_names:
        r, a = clean.recorded(name), about.loc[name]
        speed = np.gradient(r.angle, r.time)
        moment = r.moment - size * np.tanh(speed / 0.05)
        trials.append(
            carpus.Trial(
                name,
                r.time,
                r.angle,
                moment,
                r.excitation,
                a.contraction,
                a.direction,
                a.use,
                effort_percent=a.effort_percent,
            )
        )
    study = carpus.Study.from_memory(
        carpus.Model.bundled(),
        trials,
        coordinate="flexion",
        muscles=clean.muscles,
        posture={"elbow_flexion": 90.0, "pro_sup": 0.0},
        damping=np.rad2deg(0.005),
        name="with friction",
    )
    return study.load()


session = with_friction(0.4)
diagnosis = session.diagnose()
diagnosis

# %% [markdown]
# The verdict, and what the effect's size is; 0.4 N·m was put in.

# %%
print(diagnosis.verdict, diagnosis.effects)
diagnosis.parameters.round(3)

# %% [markdown]
# ## The model with the effect
#
# `add_effects` fits the muscles, then adds what the diagnosis names, step by step, each as a component of OpenSim
# where there is one. The ledger has the error of every step on training trials and on those held out, as a share of
# the maximum voluntary moment.

# %%
added = session.add_effects(diagnosis=diagnosis)
steps = added.to_pandas()
steps

# %%
axis = steps[["train", "held_out"]].mul(100).set_axis(steps["label"]).plot.barh(figsize=(7, 2.4))
axis.invert_yaxis()
axis.set_ylabel("")
axis.set_xlabel("RMSE [% of the MVC moment]")
axis.figure.tight_layout()

# %% [markdown]
# ## An effect of your own
#
# The catalogue may lack what you think of. A function of Python is an effect, too: vectorized, with parameters that
# have units and plausible ranges. Derivatives are taken from differences unless you supply them. (A formula as text,
# in a TOML file, is faster and can be written into OpenSim's model.)


# %%
def moment(speed, size, width):
    """Friction that sets in over a width of speeds [N·m]."""
    return -size * np.tanh(speed / width)


carpus.define_effect(
    "smooth_friction",
    moment,
    name="Smooth friction",
    parameters={
        "size": carpus.Amplitude("N·m", typical=0.3, plausible=(0.0, 2.0)),
        "width": carpus.Shape("rad/s", start=0.05, typical=0.03, plausible=(0.01, 0.5)),
    },
)
mine = session.diagnose(["smooth_friction", "gravity", "joint_stiffness", "joint_damping"])
print(mine)
mine.parameters.round(3)

# %%
carpus.forget_effect("smooth_friction")
