"""Bodies inside each other: depths in closed form, pairs that are left out, and MuJoCo's own
collisions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stancekit.planners.robot import hexapod
from stancekit.planners.robot.meshes import Kind, Shape
from stancekit.planners.robot.model import Limb, Robot
from stancekit.planners.robot.robot_file import drawn_urdf, named_robot
from stancekit.planners.robot.robot_model import RobotModel, model_of
from stancekit.planners.terrain import Patch
from stancekit.planners.terrain.obstacles import Obstacles
from stancekit.planners.terrain.patch import THICKNESS_M
from tests.planners.robot.made_robots import made_robots
from tests.planners.robot.small_urdfs import quadruped

pytest.importorskip("pinocchio")
pytest.importorskip("coal")
from stancekit.planners.robot.bodies import LINKS_M, TOUCH_M, Bodies
from stancekit.planners.robot.inverse_kinematics import Overlap, WholeBody
from stancekit.planners.robot.kinematics import Kinematics
from tests.planners.robot.link_frames import link_frames
from tests.refusals import refuses

UP = np.array([0.0, 0.0, 1.0])


def level(height: float = 0.0, half: float = 2.0) -> Patch:
    corners = half * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) + height * UP
    return Patch(vertices_m=corners, normal=UP, shear_reference=[1, 0, 0], friction=0.7)


def shape(
    link: str,
    kind: Kind,
    size: Sequence[float],
    at: Sequence[float] = (0, 0, 0),
    turn: object = None,
) -> Shape:
    rotation = np.eye(3) if turn is None else np.asarray(turn)
    return Shape(
        link=link,
        kind=kind,
        size_m=np.array(size),
        rotation=rotation,
        origin_m=np.array(at, dtype=float),
        collides=True,
    )


def robot(model: RobotModel) -> Robot:
    limbs = tuple(
        Limb(name=leg.name, shoulder_m=leg.hip_m - model.com_m, reach_m=leg.chain.length_m)
        for leg in model.legs
    )
    return Robot(name=model.name, mass_kg=model.mass_kg, limbs=limbs, model=model)


def bodies(shapes: Sequence[Shape], *patches: Patch, **changes: object) -> Bodies:
    """A quadruped of these shapes over a terrain."""
    model = replace(model_of(quadruped()), shapes=tuple(shapes), **changes)  # type: ignore[arg-type]
    terrain = Obstacles.of(patches) if patches else Obstacles(convex=(), closed=())
    return Bodies(Kinematics(robot(model)), terrain)


def standing(made: Bodies, height: float, *, toes: object = None, turn: object = None) -> WholeBody:
    """The posture in which it stands, its base at a height; its feet on level ground where toes are
    given.
    """
    legs = made.model.legs
    return WholeBody(
        rotation=np.eye(3) if turn is None else np.asarray(turn),
        origin_m=height * UP,
        angles=np.concatenate([leg.stance_rad for leg in legs]),
        toes_m=np.zeros((len(legs), 3)) if toes is None else np.asarray(toes),
        normals=np.tile(UP, (len(legs), 1)),
        stands=np.full(len(legs), toes is not None),
    )


def swept(made: Bodies, *postures: WholeBody) -> list[tuple[float, Overlap]]:
    """What overlaps on the way through postures, each with its moment."""
    way = replace(
        postures[0],
        **{
            of.name: np.array([getattr(each, of.name) for each in postures])
            for of in fields(WholeBody)
        },
    )
    return [each for _, block in made.sweep(way) for each in block]


@pytest.mark.parametrize("depth", [0.0011, 0.004, 0.015])
def test_a_sphere_in_a_plane_is_as_deep_as_its_radius_less_its_height(depth: float) -> None:
    made = bodies([shape("base", "sphere", [0.1], at=[0.3, 0.2, 0.0])], level())
    (found,) = made.overlaps(standing(made, 0.1 - depth))
    assert found[1:] == ("base", "patch 0")
    assert found[0] == pytest.approx(depth, abs=1e-6)


def test_a_tilted_box_is_as_deep_as_its_lowest_corner() -> None:
    half, turn = (
        np.array([0.3, 0.1, 0.05]),
        Rotation.from_euler("xyz", [0.3, -0.2, 0.5]).as_matrix(),
    )
    lowest = np.abs(turn[2]) @ half
    made = bodies([shape("base", "box", 2.0 * half)], level(half=3.0))
    (found,) = made.overlaps(standing(made, lowest - 0.006, turn=turn))
    assert found[0] == pytest.approx(0.006, abs=1e-6)
    assert not made.overlaps(standing(made, lowest + 1e-5, turn=turn))


@pytest.mark.parametrize(
    ("gap", "across"),
    [(0.05, False), (0.05, True), (0.0785, True), (0.0795, False), (0.07995, True), (0.1, True)],
)
def test_capsules_are_as_deep_as_their_radii_less_the_distance_of_their_axes(
    gap: float, across: bool
) -> None:
    """Axes that are parallel or at right angles, of capsules with radii of 3 and 5 cm."""
    lies = Rotation.from_euler("y", 90, degrees=True).as_matrix()
    leans = Rotation.from_euler("x", 90, degrees=True).as_matrix() if across else lies
    foot = bodies([shape("base", "sphere", [0.01])]).model.leg("LF").nominal_m
    shapes = [shape("base", "capsule", [0.03, 0.4], at=foot + gap * UP, turn=lies)]
    model = model_of(quadruped())
    turn, origin = link_frames(model, [leg.stance_rad for leg in model.legs])["LF_FOOT"]
    shapes += [
        shape("LF_FOOT", "capsule", [0.05, 0.2], at=turn.T @ (foot - origin), turn=turn.T @ leans)
    ]
    made = bodies(shapes)
    found = [depth_m for depth_m, *_ in made.overlaps(standing(made, 1.0))]
    assert found == ([pytest.approx(0.08 - gap, abs=1e-5)] if 0.08 - gap > LINKS_M else [])


def test_what_touches_by_less_than_the_tolerance_is_no_overlap() -> None:
    made = bodies([shape("base", "sphere", [0.1])], level())
    body = standing(made, 0.1 - 0.9 * TOUCH_M)
    assert not made.overlaps(body)
    assert made.overlaps(body, terrain_m=0.0)[0][0] == pytest.approx(0.9 * TOUCH_M, abs=1e-6)


def test_a_foot_touches_with_its_ball_and_may_be_no_deeper_where_it_stands() -> None:
    right, large = (
        [shape(f"{leg}_FOOT", "sphere", [m]) for leg in ("LF", "RF", "LH", "RH")]
        for m in (0.02, 0.03)
    )
    made = bodies(right, level(), level(0.5, 0.05))
    nominal = np.array([leg.nominal_m for leg in made.model.legs])
    height = 0.02 - nominal[:, 2].min()
    toes = np.array([*nominal.T[:2], np.zeros(4)]).T
    assert not made.overlaps(standing(made, height, toes=toes))
    assert made.overlaps(standing(made, height - 0.01, toes=toes))
    swollen = bodies(
        large, level(), level(0.5, 0.05)
    )  # of .03 m, in a robot that believes in .02 m
    found = swollen.overlaps(standing(swollen, height, toes=toes))
    assert {other for *_, other in found} == {"patch 0"}
    assert found[0][0] == pytest.approx(0.01, abs=1e-6)


def test_of_a_link_with_a_foot_the_other_shapes_are_judged() -> None:
    foot = [shape(f"{leg}_FOOT", "sphere", [0.02]) for leg in ("LF", "RF", "LH", "RH")]
    model = model_of(quadruped())
    turn, _ = link_frames(model, [leg.stance_rad for leg in model.legs])[
        "LF_FOOT"
    ]  # which the bent leg leans
    heel = shape("LF_FOOT", "sphere", [0.01], at=turn.T @ [0.02, 0.0, -0.018])
    made = bodies([*foot, heel], level())
    nominal = np.array([leg.nominal_m for leg in made.model.legs])
    toes = np.array([*nominal.T[:2], np.zeros(4)]).T
    found = made.overlaps(standing(made, 0.02 - nominal[:, 2].min(), toes=toes))
    assert [link for _, link, _ in found] == ["LF_FOOT"]
    lowest = made.model.leg("LF").nominal_m[2] - nominal[:, 2].min() + 0.02 - 0.018 - 0.01
    assert found[0][0] == pytest.approx(-lowest, abs=1e-6)
    assert found[0][0] > 1e-3


def test_neighbours_and_pairs_of_the_srdf_are_left_out_and_others_are_not() -> None:
    large = [
        shape("base", "sphere", [0.4]),
        *(shape(f"LF_{part}", "sphere", [0.3]) for part in ("HIP", "THIGH")),
    ]
    ball = shape("RF_FOOT", "sphere", [0.3])
    made = bodies([*large, ball])
    found = {(link, other) for _, link, other in made.overlaps(standing(made, 2.0))}
    assert ("base", "LF_HIP") not in found  # a joint is between them
    assert ("base", "RF_FOOT") in found
    apart = bodies([*large, ball], disabled_pairs=frozenset([frozenset(("base", "RF_FOOT"))]))
    assert {(link, other) for _, link, other in apart.overlaps(standing(apart, 2.0))} == found - {
        ("base", "RF_FOOT")
    }


def test_pairs_that_touch_in_every_posture_are_left_out_and_said() -> None:
    balls = (("base", 0.4), ("LF_THIGH", 0.1), ("LF_FOOT", 0.2))
    made = bodies([shape(link, "sphere", [radius]) for link, radius in balls])
    assert made.drawn_so == (("base", "LF_THIGH"),)
    sometimes = {(link, other) for _, link, other in made.overlaps(standing(made, 2.0))}
    assert ("base", "LF_THIGH") not in sometimes
    more = bodies([shape(link, "sphere", [radius]) for link, radius in (*balls, ("base", 0.38))])
    assert more.drawn_so == (
        ("base", "LF_THIGH"),
    )  # links, as an SRDF names them: of all shapes of theirs
    assert more.drawn_so[0] not in {
        (link, other) for _, link, other in more.overlaps(standing(more, 2.0))
    }


def test_links_that_cross_between_two_postures_are_found_as_deep_as_they_are_on_the_way() -> None:
    """Against the closed form of two balls, at a thousand moments of ways on which joints turn by
    .3 rad.
    """
    rng, radius, found = np.random.default_rng(4), 0.01, list[bool]()
    for _ in range(24):
        ball = shape("LF_SHANK", "sphere", [radius], at=[0.0, 0.05, -0.15])
        alone = bodies([ball])
        first = standing(alone, 1.0)
        last = replace(first, angles=first.angles + rng.uniform(-0.3, 0.3, len(first.angles)))
        middle = alone._placed(0.5 * (first.angles + last.angles)[None])[1][0, 0]
        made = bodies(
            [ball, shape("base", "sphere", [radius], at=middle + rng.normal(scale=0.01, size=3))]
        )
        way = first.angles + np.linspace(0.0, 1.0, 1000)[:, None] * (last.angles - first.angles)
        centres = made._placed(way)[1]
        depths = 2.0 * radius - np.linalg.norm(centres[:, 0] - centres[:, 1], axis=1)
        if max(depths[0], depths[-1], LINKS_M - np.abs(depths.max() - LINKS_M)) < 0.8 * LINKS_M:
            between = [overlap[0] for at, overlap in swept(made, first, last) if at % 1.0]
            assert bool(between) == (depths.max() > LINKS_M)
            assert max(between, default=0.0) <= max(depths.max(), 0.0) + 1e-6
            found.append(bool(between))
    assert min(found.count(True), found.count(False)) >= 5


def test_what_has_no_shape_is_said() -> None:
    parts = [
        f"{leg}_{part}" for leg in ("LF", "RF", "LH", "RH") for part in ("HIP", "THIGH", "SHANK")
    ]
    whole = [shape(part, "sphere", [0.01]) for part in (*parts, "base")]
    assert bodies(whole).missing == ()
    assert bodies([*whole, shape("base", "mesh", [1, 1, 1])]).missing == ("link base: no mesh",)
    follows = "joint wag: follows LF_HFE, which plans do not: make it a fixed joint"
    assert bodies(whole, gaps=(follows,)).missing == (follows,)  # nor is it known where those are
    feet = [shape("LF_FOOT", "sphere", [0.01])]  # the ball at its end is no shank
    (line,) = bodies(
        [each for each in whole if each.link not in ("LF_THIGH", "LF_SHANK")] + feet
    ).missing
    assert line == "joints LF_HFE, LF_KFE: no shape of what they carry"


def test_inside_of_a_closed_body_is_solid_and_behind_a_patch_is_its_thickness() -> None:
    half, ball = 0.5, [shape("base", "sphere", [0.1])]
    angles = [[0, 0, 0], [90, 0, 0], [-90, 0, 0], [180, 0, 0], [0, 90, 0], [0, -90, 0]]
    turns = Rotation.from_euler("xyz", angles, degrees=True)
    sides = [turn @ (half * UP + level(0.0, half).vertices_m).T for turn in turns.as_matrix()]
    box = [
        Patch(
            vertices_m=side.T,
            normal=(turn @ UP).round(12),
            shear_reference=turn @ [1, 0, 0],
            friction=0.7,
        )
        for side, turn in zip(sides, turns.as_matrix(), strict=True)
    ]
    made = bodies(ball, *box)
    (found,) = made.overlaps(standing(made, 0.1))
    assert found[2] == "the body of patches 0 to 5"
    assert found[0] == pytest.approx(0.5, abs=1e-5)  # 0.4 m to the top, and the radius
    plate = bodies(ball, box[0])
    assert not plate.overlaps(standing(plate, half - THICKNESS_M - 0.1001))
    assert plate.overlaps(standing(plate, half - THICKNESS_M))


def test_without_coal_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "coal", None)
    with refuses("bodies", "coal", "[robots]"):
        bodies([shape("base", "sphere", [0.1])])


def test_mujoco_finds_the_same_links_inside_the_same_things() -> None:
    mujoco = pytest.importorskip("mujoco")
    walker, rng = hexapod(), np.random.default_rng(5)
    wall = Patch(
        vertices_m=[[0.32, -1, 0], [0.32, 1, 0], [0.4, 1, 0.5], [0.4, -1, 0.5]],
        normal=np.array([-0.5, 0, 0.08]) / np.hypot(0.5, 0.08),
        shear_reference=[0, 1, 0],
        friction=0.7,
    )
    patches = (level(), wall, level(0.25, 0.1))
    solver = Kinematics(walker)
    made = Bodies(solver, Obstacles.of(patches))
    spec = mujoco.MjSpec.from_string(drawn_urdf(walker))
    spec.compiler.fusestatic = False
    spec.body("body").add_freejoint()
    for first, second in made.drawn_so:
        spec.add_exclude(bodyname1=first, bodyname2=second)
    for index, patch in enumerate(patches):
        spec.add_mesh(name=f"patch {index}", uservert=patch.solid.corners.ravel())
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"patch {index}", name=f"patch {index}"
        )
    model = spec.compile()
    data, pairs, between = mujoco.MjData(model), 0, 0
    for _ in range(100):
        angles = rng.uniform(solver.lower_rad, solver.upper_rad)
        turn = Rotation.from_rotvec(rng.uniform(-0.3, 0.3, 3))
        body = WholeBody(
            rotation=turn.as_matrix(),
            origin_m=np.array([*rng.uniform(-0.2, 0.2, 2), rng.uniform(0.05, 0.35)]),
            angles=angles,
            toes_m=np.zeros((6, 3)),
            normals=np.tile(UP, (6, 1)),
            stands=np.zeros(6, dtype=bool),
        )
        data.qpos[:3], data.qpos[3:7] = body.origin_m, turn.as_quat(scalar_first=True)
        for name, angle in zip(solver.joints, angles, strict=True):
            data.qpos[model.joint(name).qposadr[0]] = angle
        mujoco.mj_forward(model, data)
        theirs = dict[frozenset[str], float]()
        for contact in data.contact:
            names = frozenset(
                model.geom(geom).name or model.body(model.geom_bodyid[geom]).name
                for geom in (contact.geom1, contact.geom2)
            )
            theirs[names] = max(theirs.get(names, 0.0), -float(contact.dist))
        ours = {
            frozenset((link, other)): depth_m
            for depth_m, link, other in made.overlaps(body, terrain_m=0.0)
        }
        deep = [
            {names for names, depth in found.items() if depth > TOUCH_M} for found in (ours, theirs)
        ]
        assert deep[0] == deep[1]
        pairs += len(deep[0])
        between += sum(not any(name.startswith("patch") for name in names) for names in deep[0])
    assert pairs > 100
    assert between > 20


def test_shapes_are_where_pinocchio_places_their_links(tmp_path: Path) -> None:
    """Bodies are placed by chains of our own, as joints are found; pinocchio's links are the
    independent word.
    """
    import pinocchio as pin

    sound = [each for each in made_robots() if each.sound][::6]
    solvers = [
        Kinematics(hexapod()),
        *(Kinematics(named(each.write(tmp_path / each.name))) for each in sound),
    ]
    rng, looked = np.random.default_rng(5), 0
    for solver in solvers:
        made = Bodies(solver)
        known, data = solver.known, solver.known.createData()
        lower, upper = np.maximum(solver.lower_rad, -3.0), np.minimum(solver.upper_rad, 3.0)
        angles = lower + (upper - lower) * rng.uniform(size=(4, len(lower)))
        turns, origins = made._placed(angles)
        for row, own in enumerate(angles):
            pin.framesForwardKinematics(known, data, solver.configuration(own))
            for k, (each, _) in enumerate(made.model.link_shapes[0]):
                frame = data.oMf[known.getFrameId(each.link, pin.FrameType.BODY)]
                there = data.oMi[1].actInv(frame)
                np.testing.assert_allclose(turns[row, k], there.rotation @ each.rotation, atol=1e-9)
                np.testing.assert_allclose(origins[row, k], there.act(each.origin_m), atol=1e-9)
                looked += 1
    assert looked > 150


def named(path: Path) -> Robot:
    model = named_robot(str(path))
    assert model is not None
    return robot(model)
