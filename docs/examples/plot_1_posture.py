"""
From numpy to a posture, or to the reason why there is none
===========================================================

Three limbs of a hexapod on three patches of ground, written as arrays: is there a posture, and if not, what would have
to give?
"""

# %%
# A patch is a flat convex polygon with a normal, an axis for shear forces, and friction. The hexapod knows where its
# shoulders are and how far its limbs reach.

import numpy as np

import stancekit

robot = stancekit.hexapod()


def ground(corner_x: float, corner_y: float, friction: float, lean: float = 0.0) -> stancekit.Patch:
    """A square of 10 cm, 20 cm below the body, that leans about x."""
    x, y = np.array([0.0, 0.1, 0.1, 0.0]), np.array([0.0, 0.0, 0.1, 0.1])
    corners = np.stack([corner_x + x, corner_y + y, -0.2 + np.tan(lean) * y], axis=1)
    normal = np.array([0.0, -np.sin(lean), np.cos(lean)])
    return stancekit.Patch(vertices_m=corners, normal=normal, shear_reference=[1, 0, 0], friction=friction)


def problem_on(patches: dict[str, stancekit.Patch]) -> stancekit.Problem:
    """These limbs on these patches, a body that may move 8 cm."""
    contacts = [
        stancekit.Contact(
            leg=limb.name, shoulder_m=limb.shoulder_m, reach_m=limb.reach_m, patch=patches[limb.name],
            force_min=[0, -1, -1], force_max=[1, 1, 1],
        )
        for limb in robot.select(list(patches))
    ]  # fmt: skip
    return stancekit.Problem.posture(
        contacts=tuple(contacts), mass_kg=robot.mass_kg, com_nominal_m=np.zeros(3), com_radius_m=0.08
    )


# %%
# Solve
# -----
# *Feasible* comes with a posture. The verifier puts it back into every constraint; it shares no code with the planner.

patches = {"RF": ground(0.2, -0.3, 0.6), "RR": ground(-0.3, -0.3, 0.6), "LM": ground(-0.05, 0.25, 0.6, lean=0.3)}
problem = problem_on(patches)
outcome = stancekit.solve(problem)
print(outcome.status.value, "in", outcome.effort.solves, "convex problems")
print(stancekit.verify(outcome).message)
print("forces [N]\n", outcome.solution.forces_n[0].round(1))

# %%
_ = stancekit.draw(outcome.solution, caption="three limbs carry 10 kg", out="posture.png")

# %%
# And where there is none
# -----------------------
# Now the third patch leans by 60°, and all of them are slippery. *Infeasible* comes with a certificate, which is
# checked without a solver, and which says what the cheapest single change is.

slippery = problem_on({
    "RF": ground(0.2, -0.3, friction=0.2),
    "RR": ground(-0.3, -0.3, friction=0.2),
    "LM": ground(-0.05, 0.25, friction=0.1, lean=np.pi / 3),
})
refused = stancekit.solve(slippery)
print(refused.status.value, "- certificate accepted:", stancekit.verify(refused.certificate).accepted)
print(stancekit.explain(refused.certificate).message)

# %%
_ = stancekit.draw(slippery, refused.certificate, caption="no posture: the third patch lets go", out="slippery.png")
