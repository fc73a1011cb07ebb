"""
A robot and a terrain of your own, to a film
============================================

A quadruped written as a URDF, a terrain written as a mesh, a course of a few keys; a plan that the verifier accepts
with joints, torques and bodies; a picture and a film.
"""

# %%
# The robot
# ---------
# Four legs of three joints. Any URDF does: legs, feet and joints are found by their shape and names.

from pathlib import Path

import numpy as np
import trimesh

import stancekit


def part(name: str, mass: float, shape: str, xyz: str = "0 0 0") -> str:
    """A link."""
    i = mass * 0.01
    return (
        f'<link name="{name}"><inertial><origin xyz="{xyz}"/><mass value="{mass}"/>'
        f'<inertia ixx="{i}" ixy="0" ixz="0" iyy="{i}" iyz="0" izz="{i}"/></inertial>'
        f'<collision><origin xyz="{xyz}"/><geometry>{shape}</geometry></collision></link>'
    )


def turns(name: str, parent: str, child: str, xyz: str, axis: str, low: float, high: float) -> str:
    """A joint of 40 Nm."""
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}"/>'
        f'<axis xyz="{axis}"/><limit lower="{low}" upper="{high}" effort="40" velocity="10"/></joint>'
    )


def leg(name: str, x: float, y: float) -> str:
    """Hip, thigh and shank of 25 cm, a ball for a foot."""
    out, bone = 0.06 if y > 0 else -0.06, '<cylinder radius="0.02" length="0.19"/>'
    foot = f'<joint name="{name}_ankle" type="fixed"><parent link="{name}_shank"/><child link="{name}_foot"/>'
    return "".join([
        part(f"{name}_hip", 0.5, '<sphere radius="0.035"/>'),
        part(f"{name}_thigh", 0.8, bone, "0 0 -0.125"),
        part(f"{name}_shank", 0.3, bone, "0 0 -0.125"),
        part(f"{name}_foot", 0.05, '<sphere radius="0.02"/>'),
        turns(f"{name}_abduct", "trunk", f"{name}_hip", f"{x} {y} 0", "1 0 0", -0.7, 0.7),
        turns(f"{name}_swing", f"{name}_hip", f"{name}_thigh", f"0 {out} 0", "0 1 0", -1.2, 1.6),
        turns(f"{name}_knee", f"{name}_thigh", f"{name}_shank", "0 0 -0.25", "0 1 0", -2.4, -0.3),
        foot + '<origin xyz="0 0 -0.25"/></joint>',
    ])  # fmt: skip


places = {"LF": (0.22, 0.08), "RF": (0.22, -0.08), "LH": (-0.22, 0.08), "RH": (-0.22, -0.08)}
trunk = part("trunk", 8.0, '<box size="0.4 0.14 0.08"/>')
legs = "".join(leg(name, *place) for name, place in places.items())
_ = Path("dog.urdf").write_text(f'<robot name="dog">{trunk}{legs}</robot>')

# %%
# The terrain
# -----------
# Tiles that lean and differ in height, as a mesh.

rng, tiles = np.random.default_rng(0), []
for x in np.arange(-1.0, 1.2, 0.25):
    for y in np.arange(-0.75, 0.75, 0.25):
        corners = np.array([[x, y, 0.0], [x + 0.25, y, 0.0], [x + 0.25, y + 0.25, 0.0], [x, y + 0.25, 0.0]])
        lean, height = rng.uniform(-0.15, 0.15, 2), rng.uniform(-0.02, 0.02)
        corners[:, 2] = height + (corners[:, :2] - corners[:, :2].mean(axis=0)) @ lean
        tiles.append(trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False))
_ = trimesh.util.concatenate(tiles).export("tiles.stl")

# %%
# The course
# ----------
# How many key frames, who moves, where from and where to. Everything else has a default.

Path("course.yaml").write_text("""
name: tiles
robot: dog.urdf
frames: 5
gait: wave
start_m: [-0.3, 0.0, 0.40]
goal_m: [-0.14, 0.0, 0.40]
stride_m: 0.04
body: {com_radius_m: 0.08, first_radius_m: 0.05}
steps: {com_m: 0.12, toe_m: 0.3}
candidates: {count: 2, window_m: 0.2}
terrain: {kind: mesh, file: tiles.stl, friction: 0.7}
""")
outcome = stancekit.plan("course.yaml")
print(outcome.status.value)
plan = outcome.solution
print(stancekit.verify(plan).message)
print("joint angles", plan.joints_rad.shape)
stancekit.save(plan, "plan.json")

# %%
_ = stancekit.draw(plan, caption="five key frames over leaning tiles", out="plan.png")

# %%
# The film
# --------
# From the same scene that pictures are drawn from, by MuJoCo's renderer.

from stancekit.views.plans import FPS, plan_frames
from stancekit.views.video import write_video

frames = write_video("plan.mp4", plan_frames(plan, size_px=(480, 360)), fps=FPS)
print(frames, "frames")
