"""Robots: masses, limbs and joints, as contact planning and gait optimisation see them.

Read ``model`` (what a planner sees), ``limb``, ``leg``, ``reach``; ``robot_file``, ``urdf_reader``
and ``mjcf`` (files), ``robot_model``, ``leg_search`` (what they mean); ``kinematics``, ``bodies``,
``workspace`` and ``outer_sets`` (what a robot can do).
"""

from .model import Limb, Robot, hexapod

__all__ = ["Limb", "Robot", "hexapod"]
