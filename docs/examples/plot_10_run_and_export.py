"""Run a walk, export it, follow it in plain MuJoCo
================================================

What leaves is the motion that ``run`` streams, with names. A file of mjlab's layout is followed by
fifteen lines that know nothing of Stancekit: PD with the exported torques fed forward.
"""

import matplotlib.pyplot as plt
import mujoco
import numpy as np

import stancekit

level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)
walk = stancekit.walk(level, (0.2, 0.0), robot="anymal", duration_s=2.0).solution
print("run:", stancekit.run(walk).succeeded)
for name in ("walk.xml", "walk.csv"):
    print(stancekit.export(walk, name).path)
_ = stancekit.export(walk, "walk.npz", to="reference")

# %%
# Nobody's code but MuJoCo's and NumPy's.

model, ref = mujoco.MjModel.from_xml_path("walk.xml"), np.load("walk.npz")
data = mujoco.MjData(model)
mujoco.mj_resetDataKeyframe(model, data, 0)
model.actuator_gainprm[:], model.actuator_biasprm[:] = 0.0, 0.0  # torques are applied here
joints = [model.joint(name) for name in ref["joint_names"]]
at, rate = ([int(getattr(joint, key)[0]) for joint in joints] for key in ("qposadr", "dofadr"))
followed = []
for q, v, tau in zip(ref["joint_pos"], ref["joint_vel"], ref["tau"], strict=True):
    while data.time < len(followed) / ref["fps"][0]:
        data.qfrc_applied[rate] = tau + 300.0 * (q - data.qpos[at]) + 6.0 * (v - data.qvel[rate])
        mujoco.mj_step(model, data)
    followed.append(data.qpos[at].copy())
print(
    f"|q - q_ref| up to {np.abs(followed - ref['joint_pos']).max():.3f} rad, body at {data.qpos[2]:.2f} m"
)

# %%
# The CSV, plotted by five lines; and judged as anybody's.

table = np.genfromtxt("walk.csv", delimiter=",", names=True, deletechars="")
figure, axes = plt.subplots(figsize=(7, 2.5), layout="constrained")
for name in [name for name in table.dtype.names if name.startswith("q.LF")]:
    axes.plot(table["t"], table[name], label=name)
axes.legend()
figure.savefig("joints.png", dpi=110)
stancekit.save(walk, "walk.json")
print(stancekit.verify("walk.csv", terrain="walk.json").message)
