"""Quadrupeds over a step, and how many of their postures are decided: ``benchmarks/robots.py
--step``.

Robots with four legs walk over a step of 5 cm, or 8 cm where their legs are longer than .6 m, in 24
key frames; every foot's distance from its toe is pinocchio's, from the URDF and the plan's joint
angles, and the verdict is that on the plan's file alone. Natural postures: every toe on a leaning
square about where the robot stands; decided over inner sets, over outer ones where those say no.
What is neither found over the first nor refuted over the second, within a second each, is open.
"""

from __future__ import annotations

import re
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stancekit import Motion, Status
from stancekit.planners.errors import InvalidInput
from stancekit.planners.formats.motion_file import check_file, read_motion, write_motion
from stancekit.planners.problem import Problem
from stancekit.planners.problem.contact import Contact
from stancekit.planners.problem.course_file import spec_from
from stancekit.planners.problem.course_layout import build_course
from stancekit.planners.projection.whole_body import whole_body
from stancekit.planners.robot.leg import rotation_of
from stancekit.planners.robot.model import Robot
from stancekit.planners.robot.reach_sets import standing_toes
from stancekit.planners.robot.robot_file import named_robot
from stancekit.planners.robot.robot_model import RobotModel
from stancekit.planners.robot.urdf_reader import pinocchio
from stancekit.planners.robot.walker import contact_robot
from stancekit.planners.search.exact import Exact
from stancekit.planners.search.friction_margin import plan_with_reserve
from stancekit.planners.search.methods import make_planner
from stancekit.planners.terrain.patch import Patch
from stancekit.planners.verify import check_plan

FRAMES, REACHED_M = 24, 1e-4
LONG_M, RISES_M = 0.6, (0.05, 0.08)
"""Of --step: legs that are longer climb the higher step."""
SCENES = ("step", "stairs", "slope", "gap")
STAIRS, SLOPE_RAD, GAP, WIDE_M = 3, 0.25, 0.2, 0.6
"""Of scenes: steps, each of .6 of the one; a slope without end; a gap of this share of a leg; half
of their width."""
LIMIT_S = 1.0
"""For each decision on a posture."""
ASIDE, UP, SIDE, LEAN_RAD, MOVED_M = 0.25, 0.15, 0.05, 0.26, 0.05
"""Natural postures: squares of SIDE up to ASIDE and UP from the standing toes, as shares of a leg's
length, leaning up to LEAN_RAD; the centre of mass within MOVED_M of where it stands."""


def step_row(name: str, file: str, natural: int) -> dict[str, Any]:
    """A plan over a step and the decisions on natural postures."""
    try:
        model = named_robot(file)
    except InvalidInput as error:
        return {"name": name, "refused": re.sub(r"^\S+: ", "", str(error))}
    if len(model.legs) != 4:
        return {"name": name, "refused": f"expected four legs, found {len(model.legs)}"}
    try:
        course = build_course(spec_from(scene_course(model, file)))
    except InvalidInput as error:
        return {"name": name, "refused": str(error)}
    started = time.process_time()
    outcome = plan_with_reserve(make_planner("two-stage", of="courses"), course)
    found: dict[str, Any] = {
        "name": name,
        "plan_s": time.process_time() - started,
        "status": outcome.status.value,
    }
    if outcome.solution is not None:
        started = time.process_time()
        bent = whole_body(outcome.solution)
        plan, found["steps"], found["torque_share_before"] = (
            bent.plan,
            bent.steps,
            (bent.before or bent).share,
        )
        found["joints_s"] = time.process_time() - started
        with TemporaryDirectory() as folder:
            path = Path(folder) / "plan.json"
            write_motion(path, plan, check_plan(plan, joints=True))
            checked, (plan, _) = check_file(path), read_motion(path)
        errors = urdf_errors(model, plan)
        found |= {
            "accepted": checked.accepted,
            "message": checked.message,
            "feet": errors.size,
            "worst_m": float(errors.max()),
            "torque_share": checked.report.group("torque").figures.get("share"),
        }
    return found | decided(model, natural)


def decided(model: RobotModel, natural: int) -> dict[str, int]:
    """How many natural postures are found over inner sets (yes), refuted over outer ones (no), or
    neither (open).
    """
    planner, count = Exact(time_limit_s=LIMIT_S), {"yes": 0, "no": 0, "open": 0}
    inner, outer = (
        contact_robot(model, None, sets, Problem.tilt_limit_rad) for sets in ("inner", "outer")
    )
    for seed in range(natural):
        within, around = (
            natural_posture(model, each, np.random.default_rng(seed)) for each in (inner, outer)
        )
        if planner.solve(within).status is Status.FEASIBLE:
            count["yes"] += 1
        else:
            count["no" if planner.solve(around).status is Status.INFEASIBLE else "open"] += 1
    return count


def scene_course(model: RobotModel, file: str, scene: str = "step") -> dict[str, Any]:
    """Level ground and one of ``SCENES``, which the front feet meet first and the hind ones have
    passed at the end.
    """
    length, height = model.legs[0].chain.length_m, model.stand_height_m
    ahead = standing_toes(model)[:, 0]
    edge, rise = float(ahead.max()) + 0.15 * length, RISES_M[int(length > LONG_M)]
    terrain, corners = _scene(scene, edge, length, rise)
    on, (start, passed) = (
        0.25 * length,
        (edge - float(ahead.max()), corners[-1][0] - float(ahead.min())),
    )
    if scene == "slope":
        passed = edge - float(ahead.min()) + on
    path = [
        start,
        *(x - float(ahead.mean()) for x, _ in corners if start < x < passed),
        passed,
        passed + on,
    ]
    heights = [np.interp(x + ahead, *np.transpose(corners)).mean() for x in path]
    if scene == "step":
        path, heights = [start, passed, passed + on], [0.0, 0.5 * rise, 0.8 * rise]
    way = [[x, 0.0, height + float(z)] for x, z in zip(path, heights, strict=True)]
    return {
        "name": scene,
        "robot": file,
        "frames": round(FRAMES * (passed + on) / (edge - float(ahead.min()) + on)),
        "gait": "wave",
        "start_m": [0.0, 0.0, height],
        "via_m": way[:-1],
        "goal_m": way[-1],
        "body": {"com_radius_m": 0.05, "first_radius_m": 0.02},
        "steps": {"com_m": 0.12, "toe_m": 0.5, "rotation_rad": 0.15},
        "candidates": {"window_m": 0.4 * length},
        "terrain": terrain | {"friction": 0.7},
    }


def _scene(
    scene: str, edge: float, length: float, rise: float
) -> tuple[dict[str, Any], list[tuple[float, float]]]:
    """Terrain as courses have it, and the corners of its profile, (x, z) [m]."""
    if scene in ("step", "stairs"):
        steps, run = (1, 4.0) if scene == "step" else (STAIRS, 0.45 * length)
        rises = [rise if scene == "step" else 0.6 * rise] * steps
        corners = [(edge, 0.0), (edge, rises[0])]
        for k in range(1, steps):
            corners += [(edge + k * run, k * rises[0]), (edge + k * run, (k + 1) * rises[0])]
        return {"kind": "stairs", "first_m": edge, "run_m": run, "rises_m": rises}, corners
    beyond, ground = edge + 3.0, ((-1.0, 0.0), (edge, 0.0))
    if scene == "slope":
        end = (beyond, 3.0 * float(np.tan(SLOPE_RAD)))
        return _strips(ground, ((edge, 0.0), end)), [(edge, 0.0), end]
    far = edge + GAP * length
    return _strips(ground, ((far, 0.0), (beyond, 0.0))), [(edge, 0.0), (far, 0.0)]


def _strips(*strips: tuple[tuple[float, float], tuple[float, float]]) -> dict[str, Any]:
    """Strips WIDE_M wide on both sides, each between two points of a profile, (x, z) [m]."""
    polygons = [
        {"vertices_m": [[a, -WIDE_M, u], [b, -WIDE_M, v], [b, WIDE_M, v], [a, WIDE_M, u]]}
        for (a, u), (b, v) in strips
    ]
    return {"kind": "polygons", "polygons": polygons}


def urdf_errors(model: RobotModel, plan: Motion) -> NDArray[np.float64]:
    """How far pinocchio has the toes of a plan's joint angles from where the plan has them, shape
    (M, N) [m].
    """
    pin = pinocchio()
    known = pin.buildModelFromXML(model.urdf)
    data, errors = known.createData(), np.empty((plan.problem.frames, len(model.legs)))
    for k in range(plan.problem.frames):
        q = pin.neutral(known)
        assert plan.joints_rad is not None
        for name, angle in zip(model.joint_names, plan.joints_rad[k], strict=True):
            joint = known.joints[known.getJointId(name)]
            turns = angle if joint.nq == 1 else (np.cos(angle), np.sin(angle))
            q[joint.idx_q : joint.idx_q + joint.nq] = turns
        pin.forwardKinematics(known, data, q)
        turn = pin.exp3(np.array(plan.rotation_rad[k]))
        for i, leg in enumerate(model.legs):
            foot = data.oMi[known.getJointId(leg.joint_names[-1])].act(np.array(leg.chain.tip_m))
            normal = plan.problem.patch(int(plan.problem.holds[k][i]), plan.choice).normal
            toe = plan.com_m[k] + turn @ (foot - model.com_m) - leg.radius_m * normal
            errors[k, i] = np.linalg.norm(toe - plan.toes_at(k)[i])
    return errors


def natural_posture(model: RobotModel, robot: Robot, rng: np.random.Generator) -> Problem:
    """All legs on squares about where the robot stands."""
    contacts = []
    for leg, limb, toe in zip(model.legs, robot.limbs, standing_toes(model), strict=True):
        length = leg.chain.length_m
        middle = toe + length * rng.uniform([-ASIDE, -ASIDE, -UP], [ASIDE, ASIDE, UP])
        lean, azimuth, friction = rng.uniform([0.0, 0.0, 0.3], [LEAN_RAD, 2.0 * np.pi, 0.8])
        turn = rotation_of(lean * np.array([np.cos(azimuth), np.sin(azimuth), 0.0]))
        square = 0.5 * SIDE * length * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        patch = Patch(
            vertices_m=middle + square @ turn.T,
            normal=turn[:, 2],
            shear_reference=turn[:, 0],
            friction=friction,
        )
        contacts.append(
            Contact(
                leg=limb.name,
                shoulder_m=limb.shoulder_m,
                reach_m=limb.reach_m,
                patch=patch,
                force_min=np.array([0.0, -1.0, -1.0]),
                force_max=np.ones(3),
                reach_rows=limb.reach_rows,
            )
        )
    return Problem.posture(
        contacts=tuple(contacts),
        mass_kg=robot.mass_kg,
        com_nominal_m=np.zeros(3),
        com_radius_m=MOVED_M,
    )


def step_line(row: dict[str, Any]) -> str:
    """One row of --step."""
    if "refused" in row:
        return f"{row['name']:44} refused: {row['refused']:.120}"
    message = f"{row['name']:44} {row['status']}, {row['plan_s']:.1f} s"
    if "accepted" in row:
        verdict = "accepted" if row["accepted"] else "refused"
        message += f", {verdict}, {row['feet']} feet within {1e3 * row['worst_m']:.5f} mm; {row['message']}"
    share = row["open"] / max(row["yes"] + row["no"] + row["open"], 1)
    return f"{message} | natural postures: {row['yes']} yes, {row['no']} no, {row['open']} neither ({share:.1%})"
