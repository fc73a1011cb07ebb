"""Every gait, walked once over the reference ripples, and the verifier's word on what comes out."""

import numpy as np
import pytest

from stancekit.planners.gait.formulation import formulate
from stancekit.planners.gait.method.smoothing import smoothed
from stancekit.planners.problem.gaits import GAITS
from stancekit.planners.problem.walk import Walk
from stancekit.planners.robot.single_body import anymal, hexapod_walker
from stancekit.planners.terrain.reference import reference_terrain
from stancekit.planners.verify.trajectories import check_trajectory


@pytest.mark.parametrize("gait", sorted(GAITS))
def test_every_gait_crosses_ripples_and_the_verifier_accepts_it(gait: str) -> None:
    robot = hexapod_walker() if gait == "tripod" else anymal()
    goal = np.array([0.3, 0.09]) if gait == "tripod" else np.array([0.6, 0.18])
    task = Walk(
        robot=robot,
        terrain=reference_terrain("ripple"),
        start_xy_m=np.zeros(2),
        goal_xy_m=goal,
        gait=gait,
        start_yaw_rad=float(np.arctan2(goal[1], goal[0])),
        duration_s=3.0,
    )
    lowered = (
        {"mu_max": 1.0} if gait in ("bound", "tripod") else {}
    )  # their guesses are far off: no larger barriers
    found = formulate(task).solve(**lowered)
    assert found.success
    reports = [check_trajectory(found.trajectory())]
    if (
        not reports[0].accepted
    ):  # hasty gaits: what the nodes allow swings too much between them until it is smoothed
        assert gait in ("pace", "bound")
        for done in smoothed(found):
            reports.append(done.report)
            if done.report.accepted:
                break
    assert reports[-1].accepted, [report.message for report in reports]
