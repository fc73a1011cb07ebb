"""From numpy to a posture
=======================

Three limbs of a hexapod on three patches of ground, written as arrays: is there a posture?
"""

# %%
# A patch is a flat convex polygon with a normal, an axis for shear forces, and friction. The
# hexapod knows where its shoulders are and how far its limbs reach.

import numpy as np

import stancekit

robot = stancekit.hexapod()


def ground(corner_x: float, corner_y: float, lean: float = 0.0) -> stancekit.Patch:
    """A square of 10 cm, 20 cm below the body, that leans about x."""
    x, y = np.array([0.0, 0.1, 0.1, 0.0]), np.array([0.0, 0.0, 0.1, 0.1])
    corners = np.stack([corner_x + x, corner_y + y, -0.2 + np.tan(lean) * y], axis=1)
    normal = np.array([0.0, -np.sin(lean), np.cos(lean)])
    return stancekit.Patch(
        vertices_m=corners, normal=normal, shear_reference=[1, 0, 0], friction=0.6
    )


patches = {"RF": ground(0.2, -0.3), "RR": ground(-0.3, -0.3), "LM": ground(-0.05, 0.25, lean=0.3)}
contacts = [
    stancekit.Contact(
        leg=limb.name,
        shoulder_m=limb.shoulder_m,
        reach_m=limb.reach_m,
        patch=patches[limb.name],
        force_min=[0, -1, -1],
        force_max=[1, 1, 1],
    )
    for limb in robot.select(list(patches))
]
problem = stancekit.Problem.posture(
    contacts=tuple(contacts), mass_kg=robot.mass_kg, com_nominal_m=np.zeros(3), com_radius_m=0.08
)

# %%
# *Feasible* comes with a posture. The verifier puts it back into every constraint; it shares no
# code with the planner.

outcome = stancekit.solve(problem)
print(outcome.status.value, "in", outcome.effort.solves, "convex problems")
print(stancekit.verify(outcome).message)
print("forces [N]\n", outcome.solution.forces_n[0].round(1))

# %%
_ = stancekit.draw(outcome.solution, caption="three limbs carry 10 kg", out="posture.png")
