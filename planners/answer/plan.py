"""Plans: motions that answer a course by key frames, and a leap by intervals."""

from __future__ import annotations

import numpy as np

from ..problem import Problem
from ..problem.leap import Leap
from .motion import Motion

WHOLE_BODY = ("joints", "torque", "bodies", "motion")
"""Groups of a plan that are of more of the robot than its contacts; motion is bodies between key
frames."""
MARGIN = "margin"
"""The group of a plan that measures what its stances bear beyond the weight."""
LEAP_BODY = ("joints", "joint_speed", "torque", "legs_turn", "take_off", "landing", "bodies")
"""Groups of a leap that ask for a model of the robot's legs."""
LEAST_GATHER, MOST_GATHER = np.array([0.05, 0.1]), np.array([0.49, 1.0])
"""Least and largest share of a flight after which legs are drawn up, and of a fold."""
Plan = Motion[Problem]
LeapPlan = Motion[Leap]
