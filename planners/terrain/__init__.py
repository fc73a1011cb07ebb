"""Terrain: patches that toes stand on, polygons and solids behind them, meshes, grids and height
fields.

Read ``patch`` and ``polygon`` (ground as it is planned on), ``terrain_file`` (what is read), then
``mesh_footholds`` and ``map_footholds`` (meshes and grids to patches); ``families`` and ``reference``
draw grounds by name.
"""

from .patch import Patch

__all__ = ["Patch"]
