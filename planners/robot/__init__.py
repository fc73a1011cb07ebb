"""Robots: masses, limbs and joints, as contact planning and gait optimisation see them."""

from .model import Limb, Robot, hexapod

__all__ = ["Limb", "Robot", "hexapod"]
