"""Why there is no posture
=======================

Three limbs on three slippery patches, one of which leans by 60°: there is no posture, and the
answer comes with a proof that anybody can check without a solver.
"""

import numpy as np

import stancekit

robot = stancekit.hexapod()


def ground(corner_x: float, corner_y: float, friction: float, lean: float = 0.0) -> stancekit.Patch:
    """A square of 10 cm, 20 cm below the body, that leans about x."""
    x, y = np.array([0.0, 0.1, 0.1, 0.0]), np.array([0.0, 0.0, 0.1, 0.1])
    corners = np.stack([corner_x + x, corner_y + y, -0.2 + np.tan(lean) * y], axis=1)
    normal = np.array([0.0, -np.sin(lean), np.cos(lean)])
    return stancekit.Patch(
        vertices_m=corners, normal=normal, shear_reference=[1, 0, 0], friction=friction
    )


patches = {
    "RF": ground(0.2, -0.3, 0.2),
    "RR": ground(-0.3, -0.3, 0.2),
    "LM": ground(-0.05, 0.25, 0.1, lean=np.pi / 3),
}
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
# *Infeasible* comes with a certificate. The verifier computes each bound anew, and ``explain`` says
# what the cheapest single change is.

outcome = stancekit.solve(problem)
print(outcome.status.value, "- certificate accepted:", stancekit.verify(outcome).accepted)
print(stancekit.explain(outcome).message)

# %%
_ = stancekit.draw(
    problem, outcome.certificate, caption="no posture: the third patch lets go", out="slippery.png"
)
