# %% [markdown]
# # Beside OpenSim's own API
#
# The same model in OpenSim 4.6 and in Carpus: arrays are compared directly. Processor times are compared, too; their
# ratio differs by a third from run to run. This notebook needs OpenSim's Python package; it is skipped where that is
# not installed.

# %%
import tempfile
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import opensim
import pandas as pd

import carpus

opensim.Logger.setLevelString("off")
model = carpus.Model.bundled()
folder = Path(tempfile.mkdtemp())
model.write(folder / "wrist.osim")
reference = opensim.Model(str(folder / "wrist.osim"))
state = reference.initSystem()

# %% [markdown]
# ## Names
#
# | OpenSim | Carpus |
# |---|---|
# | `opensim.Model(path)` | `carpus.Model.read(path)` |
# | `model.getMuscles().get("FCR").getMaxIsometricForce()` | `model.muscles["FCR"].max_isometric_force` |
# | `muscle.set_max_isometric_force(400)` | `model.muscles["FCR"].max_isometric_force = 400` |
# | `coordinate.setValue(state, 0.3)` | `q = model.posture(flexion=0.3)` |
# | `muscle.getLength(state)`, `muscle.computeMomentArm(state, coordinate)` | `model.paths(q, about="flexion")` |
# | `model.equilibrateMuscles(state)` | `model.equilibrium(0.5, flexion=0.3)` |
# | `body.getTransformInGround(state)` | `model.poses(q)` |
# | `opensim.Manager(model).integrate(t)` | `model.forward(times)` |
# | `opensim.ForwardTool(setup).run()` and all other tools | `carpus.run_tool(setup)` |

# %% [markdown]
# ## Moment arms


# %%
def fastest(work):
    """What work gives, and the least of five processor times, of all cores [s]."""
    times_taken = []
    for _ in range(5):
        begun = time.process_time()
        found = work()
        times_taken.append(time.process_time() - begun)
    return found, min(times_taken)


angles = np.linspace(-1.0, 1.0, 201)
coordinate = reference.getCoordinateSet().get("flexion")


def arms_of_opensim():
    arms = np.zeros((len(angles), len(model.muscles)))
    for k, angle in enumerate(angles):
        coordinate.setValue(state, angle)
        reference.realizePosition(state)
        for j, name in enumerate(model.muscle_names):
            arms[k, j] = reference.getMuscles().get(name).computeMomentArm(state, coordinate)
    return arms


paths, of_carpus = fastest(lambda: model.paths(model.postures("flexion", angles), about="flexion"))
arms, of_opensim = fastest(arms_of_opensim)
print(f"largest difference {np.abs(arms - paths.moment_arm).max():.1e} m")
print(f"{of_opensim / of_carpus:.0f} times less processor time")

# %%
plt.figure(figsize=(6, 3), layout="constrained")
plt.plot(np.rad2deg(angles), 1e3 * paths.moment_arm, label=paths.muscles)
plt.plot(np.rad2deg(angles[::20]), 1e3 * arms[::20], "k.", markersize=4)
plt.xlabel("flexion [deg]")
plt.ylabel("moment arm [mm]")
plt.title("lines: Carpus, dots: OpenSim")
plt.legend(fontsize=8, loc="center left", bbox_to_anchor=(1, 0.5))
plt.show()
# %% [markdown]
# ## Muscles at rest

# %%
coordinate.setValue(state, 0.3)
for name in paths.muscles:
    reference.getMuscles().get(name).setActivation(state, 0.5)
reference.equilibrateMuscles(state)
reference.realizeDynamics(state)
rest = model.equilibrium(0.5, flexion=0.3)
pd.DataFrame(
    {
        "OpenSim [N]": [reference.getMuscles().get(m).getTendonForce(state) for m in rest.index],
        "Carpus [N]": rest["tendon_force_n"],
    },
    index=rest.index,
).round(4)

# %% [markdown]
# ## Motion from forces
#
# Flexors at half activation, everything else free: 0.2 s of OpenSim's `Manager` and of `Model.forward`.

# %%
controller = opensim.PrescribedController()
for name in paths.muscles:
    controller.addActuator(reference.getMuscles().get(name))
    controller.prescribeControlForActuator(name, opensim.Constant(0.5 if name.startswith("F") else 0.02))
reference.addController(controller)
state = reference.initSystem()
for name in paths.muscles:
    reference.getMuscles().get(name).setActivation(state, 0.02)
reference.equilibrateMuscles(state)
times = np.linspace(0, 0.2, 41)


def motion_of_opensim():
    manager = opensim.Manager(reference)
    manager.setIntegratorAccuracy(1e-6)
    manager.initialize(opensim.State(state))
    values = []
    for t in times[1:]:
        now = manager.integrate(t)
        values.append([c.getValue(now) for c in reference.getCoordinateSet()])
    return np.array(values)


excitation = np.where(np.char.startswith(model.muscle_names, "F"), 0.5, 0.02)
values, of_opensim = fastest(motion_of_opensim)
motion, of_carpus = fastest(lambda: model.forward(times, excitation, activation=0.02, accuracy=1e-6))
opensim_names = [c.getName() for c in reference.getCoordinateSet()]
i, j = motion.coordinates.index("flexion"), opensim_names.index("flexion")
difference = np.abs(motion.q[1:, i] - values[:, j]).max()
print(f"flexion after 0.2 s: {np.rad2deg(motion.q[-1, i]):.2f}°; largest difference {np.rad2deg(difference):.4f}°")
print(f"{of_opensim / of_carpus:.0f} times less processor time")
