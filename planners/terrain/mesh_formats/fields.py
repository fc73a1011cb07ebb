"""Fields of formats: those that are followed, those that a file is refused for, and those without
meaning for a surface.
"""

from __future__ import annotations

from collections.abc import Iterable

from .numbers import broken

FIELDS: dict[str, tuple[str, str, str]] = {
    ".stl": ("facet count vertex", "", "normal attribute name"),
    ".obj": ("v f", "surf curv curv2 cstype call csh", "vt vn vp p l g o s usemtl mtllib"),
    ".off": ("ST C N OFF vertices faces", "4 n BINARY", "edges colours normals"),
    ".ply": (
        "format vertex x y z face vertex_indices vertex_index",
        "tristrips",
        "comment obj_info edge material red green blue nx ny nz s t",
    ),
    ".dae": (
        "unit visual_scene node matrix translate rotate scale instance_node instance_geometry "
        "instance_controller skin bind_shape_matrix mesh vertices source accessor triangles polylist "
        "polygons trifans tristrips",
        "lookat skew ph morph convex_mesh spline brep",
        "up_axis lines linestrips normal texcoord material effect image camera light animation",
    ),
    ".glb": (
        "scene scenes nodes children mesh matrix translation rotation scale primitives mode POSITION "
        "indices byteStride normalized extensionsRequired",
        "uri sparse skin weights EXT_mesh_gpu_instancing KHR_draco_mesh_compression "
        "EXT_meshopt_compression KHR_meshopt_compression",
        "NORMAL TANGENT TEXCOORD COLOR targets materials textures samplers cameras animations extras",
    ),
}
"""By the ending of a file's name. The axis up of a .dae is what ``up`` says."""


def check_fields(suffix: str, names: Iterable[str]) -> None:
    """Raise InvalidInput for a field that moves, adds or takes away what is no surface without
    it.
    """
    if odd := sorted(set(names) & set(FIELDS[suffix][1].split())):
        raise broken(f"expected a file without {odd[0]}, which no reader here follows")
