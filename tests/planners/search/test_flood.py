"""Proofs that no balanced motion leads through a passage, and forgeries of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import shapely
from scipy.spatial.transform import Rotation

import stancekit
from stancekit import PlanSettings, Status
from stancekit.planners.answer.certificate import Certificate
from stancekit.planners.problem.course_between import laid_between
from stancekit.planners.problem.passage import Passage, tops_of_solids
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.model import Robot
from stancekit.planners.robot.outer_sets import Extent
from stancekit.planners.robot.robot_file import robot_of
from stancekit.planners.search.flood import flood
from stancekit.planners.terrain.patch import Frame
from stancekit.planners.terrain.polygon import surface_patch
from stancekit.planners.verify.flood import KINDS, _away, _Replay, check_flood

WIDE_M = 1.2


def level(x0: float, x1: float, z: float, y0: float = -WIDE_M, y1: float = WIDE_M) -> np.ndarray:
    return np.array([[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]])


def passage(kind: str, size_m: float, *, door_m: float = 0.0) -> Passage:
    """The hexapod before a step, a wall 0.12 m thick or a gap of this size, 0.5 m ahead."""
    inset, beyond = 0.02, 0.5 if kind == "step" else 0.62
    surfaces = [level(-1.3, 0.5, 0.0)]
    if kind == "gap":
        surfaces.append(level(0.5 + size_m, 2.0 + size_m, 0.0))
    elif kind == "step":
        surfaces.append(level(0.5, 2.0, size_m))
    else:
        half = 0.5 * door_m
        tops = [level(0.5, 0.62, size_m)]
        if door_m:
            tops = [
                level(0.5, 0.62, size_m, half, WIDE_M),
                level(0.5, 0.62, size_m, -WIDE_M, -half),
            ]
            surfaces.append(level(0.5, 0.62, 0.0, -half, half))
        surfaces += [*tops, level(beyond, 2.0, 0.0)]
    patches = tuple(surface_patch(each, 0.8) for each in surfaces)
    inner = []
    for each in surfaces:
        middle = each.mean(axis=0)
        inner.append(surface_patch(each + inset * np.sign(middle - each) * [1, 1, 0], 0.8))
    robot = stancekit.hexapod()
    goal = np.array([1.4 + (size_m if kind == "gap" else 0.0), 0.0])
    return Passage(
        name=kind,
        robot=robot,
        terrain=patches,
        footholds=tuple(inner),
        start_m=np.zeros(2),
        goal_m=goal,
        near_m=0.1,
    )


@pytest.fixture(scope="module")
def wall() -> Certificate:
    found = flood(passage("wall", 0.8))
    assert found is not None
    return found


@pytest.mark.parametrize("kind", ["step", "wall", "gap"])
def test_what_is_larger_than_any_reach_is_proved_and_what_is_small_is_not(kind: str) -> None:
    reach = Extent.of(stancekit.hexapod()).reach_m
    assert flood(passage(kind, 1.2 * reach)) is not None
    assert flood(passage(kind, 0.4 * reach)) is None


def test_a_door_in_a_wall_is_a_way() -> None:
    assert flood(passage("wall", 0.8, door_m=0.9)) is None


def test_a_bridge_over_a_gap_and_a_passage_below_a_bar_are_ways() -> None:
    gap = passage("gap", 0.8)
    bridge = surface_patch(level(0.45, 1.35, 0.05, -0.3, 0.3), 0.8)
    assert (
        flood(replace(gap, terrain=(*gap.terrain, bridge), footholds=(*gap.footholds, bridge)))
        is None
    )
    flat = surface_patch(level(-1.3, 2.0, 0.0), 0.8)
    bar = surface_patch(level(0.5, 0.62, 0.9), 0.8)
    below = replace(gap, terrain=(flat, bar), footholds=(flat,), goal_m=np.array([1.4, 0.0]))
    assert flood(below) is None


def solid(x0: float, x1: float, y0: float, y1: float, z0: float, z1: float) -> list[np.ndarray]:
    """Top and sides of a box, without its bottom."""
    around = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    sides = [
        np.array([[*one, z0], [*two, z0], [*two, z1], [*one, z1]])
        for one, two in zip(around, around[1:] + around[:1], strict=True)
    ]
    return [level(x0, x1, z1, y0, y1), *sides]


def on_floor(*boxes: list[np.ndarray], floor_below: bool = False) -> Passage:
    """The hexapod on a floor that goes on below boxes, where feet may stand beside them and on top."""
    floor = level(-1.3, 2.0, 0.0)
    tops = [surface_patch(each[0], 0.8) for each in boxes]
    sides = [
        surface_patch(each, 0.8, towards_m=each.mean(axis=0) + out)
        for box in boxes
        for each in box[1:]
        for out in [each.mean(axis=0) * [1, 1, 0] - box[0].mean(axis=0) * [1, 1, 0]]
    ]
    free = shapely.Polygon(floor[:, :2])
    for box in () if floor_below else boxes:
        free = free.difference(shapely.Polygon(box[0][:, :2]))
    pieces = [
        surface_patch(np.column_stack([np.array(each.exterior.coords)[:3], np.zeros(3)]), 0.8)
        for each in shapely.constrained_delaunay_triangles(free).geoms
    ]
    return Passage(
        name="floor",
        robot=stancekit.hexapod(),
        terrain=(surface_patch(floor, 0.8), *tops, *sides),
        footholds=(*pieces, *tops),
        start_m=np.zeros(2),
        goal_m=np.array([1.4, 0.0]),
        near_m=0.1,
    )


def test_a_wall_on_a_floor_that_goes_on_below_it_is_proved_and_what_has_a_way_is_not() -> None:
    wall = solid(0.5, 0.62, -WIDE_M, WIDE_M, 0.0, 0.8)
    assert flood(on_floor(wall)) is not None
    ways = [
        on_floor(wall, floor_below=True),
        on_floor(solid(0.5, 0.62, -WIDE_M, WIDE_M, 0.3, 0.8)),  # above the floor
        on_floor(solid(0.5, 0.62, -WIDE_M, 0.4, 0.0, 0.8)),  # around its end
        on_floor(wall[:2] + wall[3:]),  # through its side
        on_floor(solid(-1.2, 1.9, -1.1, 1.1, 0.0, 1.5), floor_below=True),  # in a room
    ]
    assert [flood(way) for way in ways] == [None] * 5


def test_boxes_beside_each_other_are_solids_together_and_one_open_side_opens_them() -> None:
    low, high = solid(0.0, 0.4, -0.3, 0.3, 0.0, 0.3), solid(0.4, 0.8, -0.3, 0.3, 0.0, 0.3)
    both = on_floor([low[0], low[1], *low[3:]], high[:4])
    assert tops_of_solids(both.terrain, both.footholds) == {1, 2}
    opened = on_floor([low[0], low[1], *low[3:]], [high[0], high[1], high[3]])
    assert tops_of_solids(opened.terrain, opened.footholds) == set()


def test_a_proof_survives_its_file(wall: Certificate, tmp_path: Path) -> None:
    stancekit.save(wall, tmp_path / "wall.json")
    read = stancekit.load(tmp_path / "wall.json", Certificate)
    assert isinstance(read.problem, Passage)
    np.testing.assert_array_equal(read.tree, wall.tree)
    check = stancekit.verify(str(tmp_path / "wall.json"))
    assert check.accepted
    assert stancekit.verify(read).accepted
    assert stancekit.explain(read).message in check.message


def test_a_proof_in_a_frame_says_places_of_the_world(wall: Certificate, tmp_path: Path) -> None:
    frame = Frame(origin_m=np.array([5.0, 7.0, 0.0]), heading_rad=0.5 * np.pi)
    framed = replace(wall, problem=replace(wall.refuted, frame=frame))
    stancekit.save(framed, tmp_path / "wall.json")
    said = stancekit.explain(stancekit.load(tmp_path / "wall.json")).message
    assert "(5, 7)" in said
    assert "(5, 8.4)" in said
    assert frame.in_world("at (-1e-05, 0.5), twice") == "at (4.5, 7), twice"


def _of(kind: str) -> Callable[[Certificate], np.ndarray]:
    return lambda proof: proof.tree[:, 0] == KINDS[kind]


def _without_runs(proof: Certificate) -> Certificate:
    return replace(proof, tree=proof.tree[~_of("run")(proof)])


def _one_run_short(proof: Certificate) -> Certificate:
    tree, runs = np.array(proof.tree), np.flatnonzero(_of("run")(proof))
    tree[runs[len(runs) // 2], 4] -= 2
    return replace(proof, tree=tree)


def _lower(proof: Certificate) -> Certificate:
    subject = proof.problem
    assert isinstance(subject, Passage)
    flat = [np.array(each.vertices_m) * [1, 1, 0.25] for each in subject.terrain]
    stood = [np.array(each.vertices_m) * [1, 1, 0.25] for each in subject.footholds]
    return proof.of(
        replace(
            subject,
            terrain=tuple(surface_patch(each, 0.8) for each in flat),
            footholds=tuple(surface_patch(each, 0.8) for each in stood),
        )
    )


def _asked(proof: Certificate, **places: np.ndarray) -> Certificate:
    subject = proof.problem
    assert isinstance(subject, Passage)
    return proof.of(replace(subject, **places))


def _fewer_surfaces(proof: Certificate) -> Certificate:
    rows = proof.tree[
        ~(_of("piece")(proof) & (proof.tree[:, 1] == proof.tree[_of("piece")(proof), 1].max()))
    ]
    return replace(proof, tree=rows)


def _coarser(proof: Certificate) -> Certificate:
    tree = np.array(proof.tree)
    tree[_of("spacing")(proof), 3] = 0.2
    return replace(proof, tree=tree)


@pytest.mark.parametrize(
    "forge",
    [
        _without_runs,
        _one_run_short,
        _lower,
        partial(_asked, start_m=np.array([0.9, 0.0])),
        partial(_asked, goal_m=np.array([0.1, 0.0])),
        _fewer_surfaces,
        _coarser,
        lambda proof: replace(proof, multipliers=0.5 * proof.multipliers),
    ],
)
def test_forged_proofs_are_refused(
    wall: Certificate, forge: Callable[[Certificate], Certificate]
) -> None:
    assert not check_flood(forge(wall)).accepted


def _mesh(folder: Path, height_m: float) -> Path:
    """Ground with a step all across it, as an OBJ file."""
    quads = [level(-1.3, 0.5, 0.0), level(0.5, 2.0, height_m)]
    quads.append(
        np.array(
            [[0.5, -WIDE_M, 0], [0.5, -WIDE_M, height_m], [0.5, WIDE_M, height_m], [0.5, WIDE_M, 0]]
        )
    )
    corners = "".join(f"v {x:g} {y:g} {z:g}\n" for quad in quads for x, y, z in quad)
    faces = "".join(
        f"f {4 * k + 1} {4 * k + 2} {4 * k + 3} {4 * k + 4}\n" for k in range(len(quads))
    )
    path = folder / "step.obj"
    path.write_text(corners + faces)
    return path


def test_between_places_infeasible_is_of_the_question_and_no_time_limit_changes_it(
    tmp_path: Path,
) -> None:
    path = _mesh(tmp_path, 0.9)
    ends = {"start": (0.0, 0.0), "goal": (1.4, 0.0)}
    for limit_s in (0.0, 60.0):
        answer = stancekit.plan(path, **ends, time_limit_s=limit_s)
        assert answer.status is Status.INFEASIBLE
        assert isinstance(answer.problem, Passage)
        assert stancekit.verify(answer.certificate).accepted
    assert laid_between(path, (0.0, 0.0), (1.4, 0.0)).passage().name == "step"


def _dog(folder: Path, trunk: float) -> Robot:
    """The quadruped with a trunk of so many kilograms."""
    pytest.importorskip("pinocchio")
    from tests.planners.robot.made_robots import quadruped

    (folder / "dog.urdf").write_text(quadruped(trunk=trunk))
    return robot_of(folder / "dog.urdf")


def test_where_a_robot_may_leap_the_answer_is_undecided_with_the_proof(tmp_path: Path) -> None:
    dog = _dog(tmp_path, 12.0)
    path, ends = _mesh(tmp_path, 1.3), {"start": (0.0, 0.0), "goal": (1.4, 0.0)}
    for settings, status in (
        (PlanSettings(), Status.UNDECIDED),
        (PlanSettings(push_n=1.0), Status.UNDECIDED),
        (PlanSettings(leaps=False), Status.INFEASIBLE),
    ):
        answer = stancekit.plan(path, **ends, robot=dog, settings=settings)
        assert answer.status is status
        assert stancekit.verify(answer.certificate).accepted


@pytest.mark.parametrize(("kind", "assumes"), [("gap", False), ("wall", True)])
def test_a_sentence_assumes_how_deep_the_centre_of_mass_gets_where_a_step_needs_it(
    kind: str, assumes: bool, tmp_path: Path
) -> None:
    dog = _dog(tmp_path, 0.4)
    far = 1.1 * (Extent.of(dog).reach_m + Extent.of(dog).depth_m)
    proof = flood(replace(passage(kind, far), robot=dog))
    assert ("below its surface" in stancekit.explain(proof).message) == assumes


def test_standing_still_is_a_question_with_a_plan(tmp_path: Path) -> None:
    path = _mesh(tmp_path, 0.1)
    assert stancekit.plan(path, start=(0.0, 0.0), goal=(0.0, 0.0)).status is Status.FEASIBLE


@pytest.mark.parametrize("order", [[0, 1, 2, 3], [3, 2, 1, 0], [0, 1, 1, 0], [0, 0, 1, 2]])
def test_distances_from_a_surface_seen_from_above_are_those_of_shapely(order: list[int]) -> None:
    corners, places = level(0.0, 1.0, 0.0)[order, :2], np.indices((9, 9)).reshape(2, -1).T * 0.5
    expected = shapely.distance(shapely.Polygon(corners), shapely.points(places - 2.0))
    np.testing.assert_allclose(_away(places - 2.0, corners), expected, atol=1e-12)


def _states(robot: Robot, count: int) -> Iterator[tuple[Passage, list[int]]]:
    """Balanced postures of a whole robot, tilted in any way, its centre of mass over the origin: ground
    that is right below its feet and its trunk, and the footholds that are touched.
    """
    from scipy.optimize import nnls

    known, rng = Kinematics(robot), np.random.default_rng(5)
    edges = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)[:, None]
    cone = np.hstack([0.8 * np.cos(edges), 0.8 * np.sin(edges), np.ones((8, 1))])
    trunk = (2.0 * np.indices((2, 2, 2)).reshape(3, 8).T - 1.0) * [0.2, 0.1, 0.05]
    while count:
        angles = np.concatenate([leg.random_angles(1, rng)[0] for leg in known.model.legs])
        turn = Rotation.from_rotvec(rng.choice([0.1, 1.0]) * rng.normal(size=3)).as_matrix()
        toes = (known.feet(angles) - known.com_offset(angles)) @ turn.T
        toes += [0.0, 0.0, 1.0] - known.radii_m[:, None] * [0.0, 0.0, 1.0]
        touching = sorted(rng.permutation(len(toes))[: rng.integers(2, len(toes) + 1)].tolist())
        # forces along eight edges of friction cones, about the centre of mass at (0, 0, 1)
        arms = np.repeat(toes[touching] - [0.0, 0.0, 1.0], 8, axis=0)
        wrench = np.vstack(
            [np.tile(cone.T, len(touching)), np.cross(arms, np.tile(cone, (len(touching), 1))).T]
        )
        if nnls(wrench, np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))[1] > 1e-9:
            continue
        lowest = ((trunk - known.com_offset(angles)) @ turn.T)[:, 2].min() + 1.0
        feet = [surface_patch(toe + level(-r, r, 0.0, -r, r), 0.8) for toe in toes for r in [0.012]]
        count -= 1
        yield (
            Passage(
                name="posture",
                robot=robot,
                terrain=(
                    *feet,
                    *(
                        surface_patch(level(-w, w, height - 1e-3, -w, w), 0.8)
                        for w, height in [(1.0, min(lowest, toes[:, 2].min())), (0.04, lowest)]
                    ),
                ),
                footholds=tuple(feet),
                start_m=np.zeros(2),
                goal_m=np.ones(2),
                near_m=0.01,
            ),
            touching,
        )


@pytest.mark.parametrize("trunk", [1.2, 8.0])
def test_no_state_of_a_balanced_posture_is_refuted(trunk: float, tmp_path: Path) -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)
    directions, cells = np.column_stack([np.cos(turn), np.sin(turn)]), np.zeros((200, 200), bool)
    cells[100, 100] = True
    for passage_, touching in _states(_dog(tmp_path, trunk), 12):
        rows = [(KINDS["raster"], 200, 200, -1, -1), (KINDS["spacing"], 0, 0, 0.01, 0)]
        rows += [(KINDS["piece"], i, i, 0, 0) for i in range(len(passage_.footholds))]
        proof = Certificate(tree=np.array(rows, float), multipliers=directions, problem=passage_)
        assert not _Replay(proof)._refuted(frozenset(touching), cells).any()
