"""Robots: masses, limbs and joints, as contact planning and gait optimisation see them.

Read ``model`` (what a planner sees) and ``leg``; ``robot_file``, ``urdf_reader`` and ``mjcf`` (files),
``robot_model``, ``leg_search`` (what they mean); ``kinematics``, ``inverse_kinematics``, ``bodies``,
``reach_sets`` and ``outer_sets`` (what a robot can do); ``walker`` (as one that walks or leaps).
"""

from .model import Limb, Robot, hexapod

__all__ = ["Limb", "Robot", "hexapod"]
