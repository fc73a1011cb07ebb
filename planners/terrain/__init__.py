"""Terrain: patches that toes stand on, polygons and solids behind them, meshes, grids and height
fields.
"""

from .patch import Patch

__all__ = ["Patch"]
