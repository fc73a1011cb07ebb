"""Feet on stones where they bear most
===================================

Each foot may stand anywhere on its stone. ``stancekit.margins`` says how far the centre of mass may
move before the feet no longer carry it, and the gradient of that: the feet climb it, and are put back
onto their stones after each step. Places drawn by chance are asked as often.
"""

import matplotlib.pyplot as plt
import numpy as np

import stancekit

rng = np.random.default_rng(4)
corners = np.array([[0.3, 0.2, 0.0], [-0.3, 0.2, 0.0], [-0.3, -0.2, 0.0], [0.3, -0.2, 0.0]])
stones = corners + rng.normal(0.0, 0.05, (4, 3))
normals = np.column_stack([rng.normal(0.0, 0.25, (4, 2)), np.ones(4)])
normals /= np.linalg.norm(normals, axis=1, keepdims=True)
radius, friction, com = 0.1, 0.5, np.array([0.05, 0.03, 0.4])


def on_stones(feet):
    """The nearest points of the discs."""
    away = feet - stones
    away -= normals * (away * normals).sum(axis=-1, keepdims=True)
    far = np.linalg.norm(away, axis=-1, keepdims=True)
    return stones + away * np.minimum(1.0, radius / np.maximum(far, 1e-9))


# %%
# Steps in the direction of the gradient get shorter. Nearest sides change on the way, so the best
# place is kept.

feet, path = stones, []
for k in range(40):
    found = stancekit.margins(feet[None], normals[None], friction, com[None])
    path.append((found.lower[0], feet))
    slope = found.gradient()[0][0]
    feet = on_stones(feet + radius * 0.9**k * slope / np.linalg.norm(slope))
best, chosen = max(path, key=lambda each: each[0])
drawn = on_stones(stones + rng.uniform(-radius, radius, (40, 4, 3)))
others = [stancekit.margins(one[None], normals[None], friction, com[None]) for one in drawn]
chance = np.maximum.accumulate([1e3 * one.lower[0] for one in others])
print(f"{1e3 * path[0][0]:.0f} mm, {1e3 * best:.0f} mm by gradient, {chance[-1]:.0f} by chance")

# %%
# The feet from above with where the centre of mass may go, and the margin.

figure, (above, beside) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
for limb, place in enumerate(stones):
    above.add_patch(plt.Circle(place[:2], radius, color="0.85"))
    above.plot(*np.array([feet[limb, :2] for _, feet in path]).T, color="0.5", lw=1)
above.plot(*chosen[:, :2].T, "o")
above.add_patch(plt.Circle(com[:2], best, fill=False, color="C2"))
above.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
beside.plot([1e3 * margin for margin, _ in path], label="by gradient")
beside.plot(chance, label="best by chance")
beside.set(xlabel="margins asked", ylabel="margin [mm]")
beside.legend()
figure.savefig("margin.png", dpi=110)
