"""Scenes: robots, patches and the posture problem."""

from .batch import PostureBatch
from .patch import Patch
from .posture import Contact, PostureProblem
from .robot import Limb, Robot, hexapod

__all__ = ["Contact", "Limb", "Patch", "PostureBatch", "PostureProblem", "Robot", "hexapod"]
