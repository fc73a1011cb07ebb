"""Scenes of MuJoCo as grounds: every point is as high as MuJoCo's own rays find it."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from stancekit.planners.terrain.terrain_file import read_heights, read_terrain
from stancekit.planners.terrain.triangle_mesh import TriangleMesh, raised
from tests.refusals import refuses

DOG = '<body name="dog" pos="0 0 2"><joint name="hip"/><geom size=".4"/></body>'
ROUGH = """<mujoco><asset>
  <hfield name="rough" nrow="4" ncol="5" size="2 1 .3 .1"
   elevation="0 1 2 3 4  1 0 1 0 1  2 2 5 2 2  0 0 0 0 9"/>
  <mesh name="wedge" vertex="0 0 0  1 0 0  0 1 0  1 1 0  0 0 .5  0 1 .5"/>
</asset><worldbody>
  <geom type="hfield" hfield="rough" pos="3 1 .1"/>
  <geom type="mesh" mesh="wedge" pos="-3 0 0" euler="0 0 30"/>
  <geom type="plane" size="0 0 1" pos="0 0 -.05"/>
  <body name="table" pos="0 2 0"><geom type="box" size=".5 .4 .2" euler="10 0 20"/></body>
  <body pos="0 -2 0"><geom type="cylinder" size=".4 .15"/>
    <geom type="sphere" size=".2" contype="0" conaffinity="0" pos="0 0 .5"/></body>
  <geom type="ellipsoid" size=".5 .3 .2" pos="2 -3 0"/>
  <geom type="capsule" size=".2 .5" pos="-2 -3 0" euler="90 0 0"/>
  {dog}
</worldbody></mujoco>"""


def scene(text: str, folder: Path) -> Path:
    """The file of a scene."""
    (folder / "scene.xml").write_text(text)
    return folder / "scene.xml"


def test_every_point_is_as_high_as_the_rays_of_mujoco_find_it(tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match="dog"):  # which is left out
        mesh = read_terrain(scene(ROUGH.format(dog=DOG), tmp_path))
    assert isinstance(mesh, TriangleMesh)
    model = mujoco.MjModel.from_xml_string(ROUGH.format(dog=""))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    x, y = np.linspace(-4.0, 5.0, 73), np.linspace(-4.0, 3.0, 61)
    ours = raised(mesh.spread_m, x, y)
    seen = np.zeros(1, dtype=np.int32)
    down, above = np.array([0.0, 0.0, -1.0]), np.stack(np.meshgrid(x, y, [5.0], indexing="ij"), -1)
    rays = [mujoco.mj_ray(model, data, p, down, None, 1, -1, seen) for p in above.reshape(-1, 3)]
    theirs = 5.0 - np.array(rays).reshape(ours.shape)
    theirs[theirs > 0.6] = np.nan  # the ball that nothing meets
    off = np.abs(ours - theirs)
    assert np.nanquantile(off, 0.98) < 2e-3  # of round things a polygon
    field = (x[:, None] > 1.05) & (x[:, None] < 4.95) & (y > 0.05) & (y < 1.95)
    assert np.quantile(off[field], 0.99) < 1e-6  # a ray of MuJoCo 3.3 misses an edge


def test_a_walk_s_ground_is_the_scene_from_above(tmp_path: Path) -> None:
    slab = '<geom type="plane" size="1 1 1" euler="0 -10 0"/>'
    field = read_heights(scene(f"<mujoco><worldbody>{slab}</worldbody></mujoco>", tmp_path))
    np.testing.assert_allclose(
        field.height(np.array([[0.5, 0.0]])), 0.5 * np.tan(np.deg2rad(10.0)), atol=1e-6
    )


def test_a_hollow_mesh_is_its_hull_and_what_only_pairs_let_meet_is_ground(tmp_path: Path) -> None:
    cup = "0 0 0  1 0 0  1 1 0  0 1 0  0 0 1  1 0 1  1 1 1  0 1 1  .5 .5 .2"
    faces = "0 2 1 0 3 2 0 1 5 0 5 4 1 2 6 1 6 5 2 3 7 2 7 6 3 0 4 3 4 7 4 5 8 5 6 8 6 7 8 7 4 8"
    geom = '<geom name="cup" type="mesh" mesh="cup" contype="0" conaffinity="0"/>'
    text = f"""<mujoco><asset><mesh name="cup" vertex="{cup}" face="{faces}"/></asset>
      <worldbody>{geom}<geom name="ball" size=".1" contype="0" conaffinity="0"/></worldbody>
      <contact><pair geom1="cup" geom2="ball"/></contact></mujoco>"""
    with pytest.warns(UserWarning, match="cup"):
        mesh = read_terrain(scene(text, tmp_path))
    assert isinstance(mesh, TriangleMesh)
    assert np.ptp(mesh.spread_m[..., 2]) == pytest.approx(1.1)  # and half of the ball


@pytest.mark.parametrize(
    ("world", "named"),
    [
        (DOG, ("scene.xml", "dog", "ground")),
        ('<geom type="plane" size="1 1 1" contype="0" conaffinity="0"/>', ("ground",)),
        ("<geom/>", ("MJCF",)),
    ],
)
def test_a_scene_without_a_ground_is_refused(
    world: str, named: tuple[str, ...], tmp_path: Path
) -> None:
    with refuses(*named):
        read_terrain(scene(f"<mujoco><worldbody>{world}</worldbody></mujoco>", tmp_path))
