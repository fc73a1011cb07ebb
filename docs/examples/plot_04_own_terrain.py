"""A terrain of your own
=====================

Tiles that lean and differ in height, as a mesh: where may feet stand, and what is the plan from
here to there?
"""

import numpy as np
import trimesh

import stancekit

rng, tiles = np.random.default_rng(0), []
for x in np.arange(-1.0, 1.2, 0.25):
    for y in np.arange(-0.75, 0.75, 0.25):
        corners = np.array(
            [[x, y, 0.0], [x + 0.25, y, 0.0], [x + 0.25, y + 0.25, 0.0], [x, y + 0.25, 0.0]]
        )
        lean, height = rng.uniform(-0.15, 0.15, 2), rng.uniform(-0.02, 0.02)
        corners[:, 2] = height + (corners[:, :2] - corners[:, :2].mean(axis=0)) @ lean
        tiles.append(trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False))
_ = trimesh.util.concatenate(tiles).export("tiles.stl")

# %%
# Footholds are planar convex pieces, a margin in from every edge.

found = stancekit.terrain("tiles.stl", friction=0.7)
print(len(found.pieces), "patches,", round(found.area_m2, 2), "m²")

# %%
# Frames, gait and candidates are laid out between the start and the goal.

answer = stancekit.plan(found, start=(0.0, 0.0), goal=(0.3, 0.0))
print(answer.status.value, answer.report.message)
_ = stancekit.draw(answer.solution, caption="over tiles that lean", out="tiles.png")
