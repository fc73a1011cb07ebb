"""URDFs written in place: a quadruped whose limbs may come in any order, and what can be wrong with
one.
"""

from collections.abc import Sequence

MASS = '<inertial><mass value="{0}"/><inertia ixx=".01" ixy="0" ixz="0" iyy=".01" iyz="0" izz=".01"/></inertial>'
LIMITS = {"HAA": (-0.7, 0.7), "HFE": (-1.2, 1.4), "KFE": (-2.4, -0.3)}
HIPS = {"LF": (0.3, 0.15), "RF": (0.28, -0.14), "LH": (-0.31, 0.16), "RH": (-0.29, -0.13)}


def link(name: str, mass: float = 1.0, geometry: str = "") -> str:
    shape = f"<collision><geometry>{geometry}</geometry></collision>" if geometry else ""
    return f'<link name="{name}">{MASS.format(mass) if mass else ""}{shape}</link>'


def joint(
    name: str, parent: str, child: str, xyz: str = "0 0 0", axis: str = "0 1 0", extra: str = ""
) -> str:
    """A joint that turns; extra: in place of its limits."""
    extra = extra or '<limit lower="-1" upper="1" effort="40" velocity="10"/>'
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>{extra}</joint>'
    )


def fixed(name: str, parent: str, child: str, xyz: str = "0 0 0") -> str:
    return (
        f'<joint name="{name}" type="fixed"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/></joint>'
    )


def limit(name: str, effort: float = 40.0) -> str:
    low, high = LIMITS[name]
    return f'<limit lower="{low}" upper="{high}" effort="{effort}" velocity="10"/>'


def small(link: str, mass: float, is_small: bool = True) -> str:
    """A link with moments of inertia of a mass within some centimetres, in place of some
    decimetres.
    """
    return link.replace('".01"', f'"{1e-4 * mass}"') if is_small else link


def leg(name: str, effort: float = 40.0, mass: float = 1.0, bone: str = "") -> str:
    """Three joints, thigh and shank of .3 m, a ball for a foot; every leg a little different. bone:
    shape of its links, about each one's origin.
    """
    x, y = HIPS[name]
    side = 0.05 if y > 0 else -0.05
    return "".join(
        [
            *(
                small(link(f"{name}_{part}", mass, bone), mass, bool(bone))
                for part in ("HIP", "THIGH", "SHANK")
            ),
            small(link(f"{name}_FOOT", 0.1 * mass, '<sphere radius="0.02"/>'), mass),
            joint(
                f"{name}_HAA", "base", f"{name}_HIP", f"{x} {y} 0", "1 0 0", limit("HAA", effort)
            ),
            joint(
                f"{name}_HFE",
                f"{name}_HIP",
                f"{name}_THIGH",
                f"0 {side} 0",
                "0 1 0",
                limit("HFE", effort),
            ),
            joint(
                f"{name}_KFE",
                f"{name}_THIGH",
                f"{name}_SHANK",
                "0 0 -.3",
                "0 1 0",
                limit("KFE", effort),
            ),
            fixed(
                f"{name}_ANKLE",
                f"{name}_SHANK",
                f"{name}_FOOT",
                f"0 0 {-0.3 - 0.01 * len(name) * abs(x)}",
            ),
        ]
    )


def robot(parts: Sequence[str], name: str = "quadruped", trunk: float = 10.0) -> str:
    body = link("base", trunk, '<box size="0.6 0.25 0.1"/>')
    return f'<?xml version="1.0"?>\n<robot name="{name}">{body}{"".join(parts)}</robot>'


def quadruped(
    order: Sequence[str] = ("LF", "RF", "LH", "RH"),
    *,
    effort: float = 40.0,
    mass: float = 1.0,
    bone: str = "",
) -> str:
    return robot([leg(name, effort, mass, bone) for name in order], trunk=10.0 * mass)


BOX = '<box size="0.16 0.08 0.02"/>'
CORNERS = [f"{x} {y} -0.035" for x in (-0.08, 0.08) for y in (-0.04, 0.04)]
FEET = {
    "box": [(BOX, "0 0 -0.03")],
    "balls": [('<sphere radius="0.005"/>', corner) for corner in CORNERS],
    "ankle": [(BOX, "0 0 -0.03"), ('<box size="0.3 0.3 0.01"/>', "0 0 0.01")],
    "ball": [('<sphere radius="0.03"/>', "0 0 -0.01")],
    "wheel": [('<sphere radius="0.03"/>', "0 0 0")],
}
JOINTS = (
    ("hip_roll", "1 0 0", 0.0),
    ("hip_pitch", "0 1 0", 0.0),
    ("hip_yaw", "0 0 1", 0.0),
    ("knee", "0 1 0", -0.3),
    ("heel", "0 1 0", -0.3),
    ("foot", "1 0 0", 0.0),
)


def biped(foot: str = "box", effort: float = 60.0, heel: float = 1.2, heel_nm: float = 0.0) -> str:
    """Hips of three joints, a knee and ankles of two; thigh and shank of 0.3 m.

    Arguments:
        heel: how far ankles pitch either way [rad].
        heel_nm: their torque, that of the others where 0 [Nm].
    """
    shapes = "".join(
        f'<collision><origin xyz="{at}"/><geometry>{what}</geometry></collision>'
        for what, at in FEET[foot]
    )
    parts = []
    for side, y in (("left", 0.08), ("right", -0.08)):
        before = "base"
        for name, axis, drop in JOINTS:
            most = heel if name == "heel" else 1.2
            low, high = (0.0, 2.2) if name == "knee" else (-most, most)
            most_nm = heel_nm if name == "heel" and heel_nm else effort
            held = f'<limit lower="{low}" upper="{high}" effort="{most_nm}" velocity="8"/>'
            if foot == "wheel" and name == "foot":
                axis, held = "0 1 0", '<limit lower="-9" upper="9" effort="9" velocity="8"/>'
            place, own = f"0 {y if before == 'base' else 0} {drop}", f"{side}_{name}"
            parts += [joint(f"{own}_j", before, own, place, axis, held), small(link(own, 0.3), 0.3)]
            before = own
        parts[-1] = parts[-1].replace("</link>", f"{shapes}</link>")
    return robot(parts, "biped")
