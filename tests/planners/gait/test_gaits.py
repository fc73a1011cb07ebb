"""Every gait, walked once over the reference ripples, and the verifier's word on what comes out."""

import numpy as np
import pytest

from stancekit.planners.answer.report import Report
from stancekit.planners.answer.trajectory import Trajectory
from stancekit.planners.gait.gait_program import formulate
from stancekit.planners.gait.method.smoothing import smoothed
from stancekit.planners.problem.walk import GAITS, Walk
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
    # the tripod's guess is far off: no larger barriers; where a bound's walk ends depends on the
    # processor's last bits: from one of two
    barriers = {"tripod": [{"mu_max": 1.0}], "bound": [{}, {"mu_max": 1.0}]}
    reports = list[Report[Trajectory]]()
    for options in barriers.get(gait, [{}]):
        found = formulate(task).solve(**options)
        reports.append(check_trajectory(found.trajectory()))
        if (
            not reports[-1].accepted
        ):  # hasty gaits: what the nodes allow swings too much between them until it is smoothed
            assert gait in ("pace", "bound")
            for done in smoothed(found):
                reports.append(done.report)
                if done.report.accepted:
                    break
        if reports[-1].accepted:
            break
    assert found.success
    assert reports[-1].accepted, [report.message for report in reports]
