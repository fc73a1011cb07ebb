"""Sixty robots of our own making, sound ones and others, and a judge of how one stands that knows
nothing of planners.

Feet of six shapes at three places, meshes, inertias, joints of all types, arms, units, axes.
``lowest_m`` poses a robot by pinocchio and has the lowest point of every link from the shapes as
the URDF's text has them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

Array = np.ndarray[Any, Any]
LEGS = {"LF": (0.19, 0.09), "RF": (0.19, -0.09), "LH": (-0.19, 0.09), "RH": (-0.19, -0.09)}
MIDDLE = {"LM": (0.0, 0.13), "RM": (0.0, -0.13)}
OUTER = {"LA": (0.08, 0.14), "RA": (0.08, -0.14), "LB": (-0.08, 0.14), "RB": (-0.08, -0.14)}
SHAPES = ("sphere", "capsule", "ball-mesh", "box", "cylinder", "cone-mesh")
PLACES = ("own-link", "on-shank", "beside-origin")
BALLS = ("sphere", "capsule", "ball-mesh")
R = 0.02
"""Radius of a foot [m]."""


@dataclass(frozen=True, kw_only=True)
class Made:
    """A robot: its URDF, files beside it, keys of a YAML file about it, and whether it is sound or
    what is wrong.
    """

    name: str
    urdf: str
    files: Mapping[str, str] = field(default_factory=dict)
    keys: str = ""
    wrong: str = ""

    @property
    def sound(self) -> bool:
        return not self.wrong

    def write(self, folder: Path) -> Path:
        """Write it into a folder; returns what a person would name: the YAML file where there is
        one.
        """
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in {"robot.urdf": self.urdf, **self.files}.items():
            (folder / name).write_text(text)
        if not self.keys:
            return folder / "robot.urdf"
        (folder / "robot.yaml").write_text(f"urdf: robot.urdf\n{self.keys}")
        return folder / "robot.yaml"


def obj(points: Array) -> str:
    """An OBJ file of the hull of points, shape (K, 3) [m]; all of them are corners of it or
    inside.
    """
    from scipy.spatial import ConvexHull

    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in points]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in ConvexHull(points).simplices]
    return "\n".join(lines) + "\n"


def ball(count: int = 600, radius_m: float = R) -> Array:
    """Points all over a ball (Fibonacci's lattice), shape (count, 3)."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count)
    flat = np.sqrt(1.0 - z**2)
    return np.asarray(radius_m * np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z]))


def cone() -> Array:
    """A cone that stands on its base, shape (25, 3)."""
    turn = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    rim = np.column_stack([R * np.cos(turn), R * np.sin(turn), np.full(24, -R)])
    return np.vstack([rim, [[0.0, 0.0, 2.0 * R]]])


GEOMETRY = {
    "sphere": f'<sphere radius="{R}"/>',
    "capsule": f'<capsule radius="{R}" length="0.06"/>',
    "ball-mesh": '<mesh filename="ball.obj"/>',
    "box": f'<box size="{2 * R} {2 * R} {2 * R}"/>',
    "cylinder": '<cylinder radius="0.035" length="0.02"/>',
    "cone-mesh": '<mesh filename="cone.obj"/>',
}
FILES = {"ball-mesh": {"ball.obj": obj(ball())}, "cone-mesh": {"cone.obj": obj(cone())}}


def _collision(geometry: str, at: Sequence[float] = (0, 0, 0), rpy: str = "0 0 0") -> str:
    x, y, z = at
    return f'<collision><origin xyz="{x:g} {y:g} {z:g}" rpy="{rpy}"/><geometry>{geometry}</geometry></collision>'


def _link(
    name: str, mass: float, shapes: str = "", moments: Sequence[float] | None = None, s: float = 1.0
) -> str:
    xx, yy, zz = moments or (4e-3 * mass * s * s,) * 3
    body = f'<mass value="{mass:g}"/><inertia ixx="{xx:g}" ixy="0" ixz="0" iyy="{yy:g}" iyz="0" izz="{zz:g}"/>'
    return f'<link name="{name}">{f"<inertial>{body}</inertial>" if mass else ""}{shapes}</link>'


def _joint(
    name: str, kind: str, parent: str, child: str, at: str, axis: str, limits: str = ""
) -> str:
    limit = f"<limit {limits}/>" if limits else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/>'
        f'<axis xyz="{axis}"/>{limit}</joint>'
    )


def _scaled(geometry: str, s: float) -> str:
    """A geometry whose numbers are so many times as large."""
    return (
        geometry
        if s == 1.0
        else re.sub(r"[\d.]+(?=[\" ])", lambda found: f"{float(found[0]) * s:g}", geometry)
    )


def _foot(leg: str, shape: str, place: str, s: float, mass: float) -> tuple[str, str]:
    """Collisions on the shank; and the foot's own link and joint."""
    rpy = "1.5708 0 0" if shape == "cylinder" else "0 0 0"
    geometry = _scaled(GEOMETRY[shape], s)
    lift = 0.03 * s if shape == "capsule" else 0.0
    if place == "on-shank":
        return _collision(geometry, (0, 0, -0.2 * s + lift), rpy), ""
    aside = (0.01 * s, 0.0, -0.05 * s) if place == "beside-origin" else (0.0, 0.0, 0.0)
    at = f"{-aside[0]:g} 0 {-0.2 * s - aside[2]:g}"
    own = _link(
        f"{leg}_foot", mass, _collision(geometry, (aside[0], 0, aside[2] + lift), rpy), (1e-5,) * 3
    )
    return "", own + _joint(f"{leg}_fix", "fixed", f"{leg}_shank", f"{leg}_foot", at, "1 0 0")


def quadruped(
    *,
    shape: str = "sphere",
    place: str = "own-link",
    legs: Mapping[str, tuple[float, float]] = LEGS,
    s: float = 1.0,
    joints: str = "revolute",
    effort: float = 40.0,
    flip: Sequence[str] = (),
    trunk: float = 6.0,
    foot_kg: float = 0.05,
    moments: Sequence[float] | None = None,
    shank: str = '<box size="0.016 0.016 0.16"/>',
    shank_kg: float = 0.15,
    knee: str = "revolute",
    root: str = "",
    extra: str = "",
    y_up: bool = False,
) -> str:
    """A robot of legs of three joints, .2 m of thigh and of shank; the trunk's x is ahead and z up,
    or y up.
    """
    parts = []
    if root in ("floating", "planar", "fixed"):
        parts.append(
            f'<link name="world"/>{_joint("root", root, "world", "trunk", "0 0 0", "0 0 1")}'
        )
    size = f'<box size="{0.4 * s:g} {0.2 * s:g} {0.1 * s:g}"/>'
    own = moments or (0.025 * s * s, 0.085 * s * s, 0.1 * s * s)
    if y_up:
        parts.append(_link("base", 1.0, _collision('<sphere radius="0.01"/>')))
        parts.append(
            '<joint name="lie" type="fixed"><parent link="base"/><child link="trunk"/><origin xyz="0 0 0" '
            'rpy="-1.5707963 0 0"/></joint>'
        )
    parts.append(_link("trunk", trunk, _collision(size), own))
    for leg, (x, y) in legs.items():
        side, f = (1 if y > 0 else -1), (-1 if leg in flip else 1)
        kinds = {"HAA": joints, "HFE": joints, "KFE": knee if knee != "revolute" else joints}

        def limits(low: float, high: float, kind: str, f: int = f) -> str:
            bounds = f'lower="{min(f * low, f * high):g}" upper="{max(f * low, f * high):g}" '
            return f'{"" if kind == "continuous" else bounds}effort="{effort:g}" velocity="20"'

        thin = _scaled(shank, s)
        on_shank, foot = _foot(leg, shape, place, s, foot_kg)
        weight = shank_kg + (foot_kg if place == "on-shank" else 0.0)
        parts += [
            _link(
                f"{leg}_hip",
                0.6,
                _collision(f'<sphere radius="{0.03 * s:g}"/>', (0, 0.02 * s * side, 0)),
                s=s,
            ),
            _link(
                f"{leg}_thigh",
                0.9,
                _collision(
                    f'<box size="{0.03 * s:g} {0.025 * s:g} {0.16 * s:g}"/>', (0, 0, -0.1 * s)
                ),
                s=s,
            ),
            _link(f"{leg}_shank", weight, on_shank + _collision(thin, (0, 0, -0.1 * s)), s=s),
            _joint(
                f"{leg}_HAA",
                kinds["HAA"],
                "trunk",
                f"{leg}_hip",
                f"{x * s:g} {0.6 * y * s:g} 0",
                f"{f} 0 0",
                limits(-0.8, 0.8, kinds["HAA"]),
            ),
            _joint(
                f"{leg}_HFE",
                kinds["HFE"],
                f"{leg}_hip",
                f"{leg}_thigh",
                f"0 {0.08 * s * side:g} 0",
                f"0 {f} 0",
                limits(-1.0, 2.2, kinds["HFE"]),
            ),
            _joint(
                f"{leg}_KFE",
                kinds["KFE"],
                f"{leg}_thigh",
                f"{leg}_shank",
                f"0 0 {-0.2 * s:g}",
                "0 0 1" if knee == "prismatic" else f"0 {f} 0",
                limits(-0.05, 0.05, knee)
                if knee == "prismatic"
                else limits(-2.5, -0.5, kinds["KFE"]),
            ),
            foot,
        ]
    return f'<?xml version="1.0"?>\n<robot name="made">{"".join(parts)}{extra}</robot>\n'


def arm(name: str, at: str, links: Sequence[str], reach_m: float = 0.25) -> str:
    """A chain of three joints that can hang down as low as the legs."""
    parts, before = [], "trunk"
    for i, link in enumerate(links):
        place = at if i == 0 else f"{reach_m:g} 0 0"
        parts.append(
            _link(f"{name}_{link}", 0.1, _collision('<sphere radius="0.015"/>', (reach_m, 0, 0)))
        )
        limits = 'lower="-1.5" upper="1.5" effort="20" velocity="5"'
        parts.append(
            _joint(
                f"{name}_{link}_joint", "revolute", before, f"{name}_{link}", place, "0 1 0", limits
            )
        )
        before = f"{name}_{link}"
    return "".join(parts)


def made_robots() -> Iterator[Made]:
    """All of them, in a fixed order."""
    for shape in SHAPES:
        for place in PLACES:
            wrong = "" if shape in BALLS else "nobody knows what touches"
            text = quadruped(shape=shape, place=place)
            yield Made(name=f"{shape}-{place}", urdf=text, files=FILES.get(shape, {}), wrong=wrong)
    yield from _described()
    yield from _meshes()
    yield from _masses()
    yield from _joints()
    yield from _bodies()


def _described() -> Iterator[Made]:
    """Feet that are no balls, with what touches in a YAML file: balls around them, and points that
    are not.
    """
    around = np.sqrt(3.0) * R + 1e-4
    yield Made(
        name="box-in-a-ball",
        urdf=quadruped(shape="box"),
        keys=f'contacts: {{"*_foot": {{radius_m: {around:.5f}}}}}\n',
    )
    yield Made(
        name="cylinder-in-a-ball",
        urdf=quadruped(shape="cylinder"),
        keys='contacts: {"*_foot": {radius_m: 0.037}}\n',
    )
    yield Made(
        name="cone-in-a-ball",
        urdf=quadruped(shape="cone-mesh"),
        files=FILES["cone-mesh"],
        keys='contacts: {"*": {point_m: [0, 0, 0.005], radius_m: 0.0355}}\n',
    )
    yield Made(
        name="wheel-as-a-point",
        urdf=quadruped(shape="cylinder"),
        keys='contacts: {"*_foot": {}}\n',
        wrong="its wheels are 3.5 cm deep where its points stand",
    )
    yield Made(
        name="box-as-a-small-ball",
        urdf=quadruped(shape="box"),
        keys='contacts: {"*_foot": {radius_m: 0.01}}\n',
        wrong="its boxes are deeper than the ball",
    )


def _meshes() -> Iterator[Made]:
    half = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * [
        0.008,
        0.008,
        0.08,
    ]
    bone = {"bone.obj": obj(half)}
    mesh = '<mesh filename="bone.obj"/>'
    yield Made(name="shanks-of-meshes", urdf=quadruped(shank=mesh), files=bone)
    yield Made(
        name="mirrored-shanks",
        urdf=quadruped(shank='<mesh filename="bone.obj" scale="1 -1 1"/>'),
        files=bone,
    )
    yield Made(
        name="shanks-in-mm",
        urdf=quadruped(shank='<mesh filename="bone.obj" scale=".001 .001 .001"/>'),
        files={"bone.obj": obj(1e3 * half)},
    )
    yield Made(
        name="shanks-in-mm-unscaled",
        urdf=quadruped(shank=mesh),
        files={"bone.obj": obj(1e3 * half)},
        wrong="shanks of 160 m",
    )
    many = ball(25_000, 0.02)
    yield Made(
        name="balls-of-many-corners",
        urdf=quadruped(shape="ball-mesh"),
        files={"ball.obj": obj(many)},
    )
    fin = np.vstack([half, [[0.15, 0.0, -0.14]]])
    yield Made(
        name="shanks-with-a-fin",
        urdf=quadruped(shank=mesh),
        files={"bone.obj": obj(fin)},
        wrong="fins go lower than the feet",
    )
    yield Made(
        name="feet-cut-off",
        urdf=quadruped(shape="ball-mesh"),
        files={"ball.obj": obj(ball())[:400]},
        wrong="a mesh that cannot be had",
    )
    yield Made(
        name="feet-missing", urdf=quadruped(shape="ball-mesh"), wrong="a mesh that is not there"
    )
    yield Made(
        name="feet-of-no-size",
        urdf=quadruped().replace('<sphere radius="0.02"/>', '<sphere radius="0"/>'),
        wrong="no simulator has such a ball",
    )
    squashed = ball() * [1.0, 1.0, 0.4]
    yield Made(
        name="feet-squashed",
        urdf=quadruped(shape="ball-mesh"),
        files={"ball.obj": obj(squashed)},
        wrong="no ball",
    )


def _masses() -> Iterator[Made]:
    yield Made(name="negative-moment", urdf=quadruped(moments=(-0.02, 0.08, 0.1)), wrong="no body")
    yield Made(name="broken-triangle", urdf=quadruped(moments=(0.01, 0.01, 0.1)), wrong="no body")
    yield Made(
        name="moments-in-kg-mm2", urdf=quadruped(moments=(25e3, 85e3, 100e3)), wrong="no body"
    )
    yield Made(name="trunk-without-mass", urdf=quadruped(trunk=0.0), wrong="a trunk without a mass")
    yield Made(name="shanks-of-negative-mass", urdf=quadruped(shank_kg=-0.15), wrong="no mass")
    yield Made(name="feet-without-mass", urdf=quadruped(foot_kg=0.0))


def _joints() -> Iterator[Made]:
    yield Made(name="joints-that-turn-freely", urdf=quadruped(joints="continuous"))
    yield Made(name="joints-without-effort", urdf=quadruped(effort=0.0), wrong="no torque limits")
    yield Made(name="knees-that-slide", urdf=quadruped(knee="prismatic"), wrong="cannot be run")
    yield Made(name="floating-root", urdf=quadruped(root="floating"))
    yield Made(name="planar-root", urdf=quadruped(root="planar"))
    yield Made(name="fixed-root", urdf=quadruped(root="fixed"))
    knee = '<limit lower="-2.5"'
    mimic = quadruped().replace(knee, f'<mimic joint="LF_HFE"/>{knee}')
    yield Made(name="knees-that-mimic", urdf=mimic, wrong="joints of no motor of their own")
    yield Made(name="flipped-axes", urdf=quadruped(flip=("RF", "RH")))
    long_axes = quadruped().replace('axis xyz="0 1 0"', 'axis xyz="0 3 0"')
    yield Made(name="axes-that-are-no-unit-vectors", urdf=long_axes)
    yield Made(name="weak-joints", urdf=quadruped(effort=0.2), wrong="cannot carry its weight")


def _bodies() -> Iterator[Made]:
    yield Made(name="six-legs", urdf=quadruped(legs={**LEGS, **MIDDLE}))
    yield Made(name="eight-legs", urdf=quadruped(legs={**LEGS, **OUTER}))
    yield Made(
        name="arm-on-the-back", urdf=quadruped(extra=arm("arm", "0.1 0 0.06", ("a", "b", "c")))
    )
    yield Made(
        name="chain-in-front", urdf=quadruped(extra=arm("x", "0.2 0 0.0", ("a", "b", "c", "d")))
    )
    arms = arm("left_arm", "0.2 0.06 0.05", ("a", "b")) + arm(
        "right_arm", "0.2 -0.06 0.05", ("a", "b")
    )
    yield Made(name="two-arms", urdf=quadruped(extra=arms))
    yield Made(name="tail", urdf=quadruped(extra=arm("tail", "-0.2 0 0", ("a", "b", "c"))))
    yield Made(name="y-up", urdf=quadruped(y_up=True), wrong="z does not point up")
    yield Made(
        name="y-up-told", urdf=quadruped(y_up=True), keys="root_rpy_rad: [1.5707963, 0, 0]\n"
    )
    yield Made(name="small", urdf=quadruped(s=0.5))
    yield Made(name="large", urdf=quadruped(s=2.0, effort=120.0))
    yield Made(name="in-millimetres", urdf=quadruped(s=1000.0), wrong="legs of 400 m")
    heel = _collision('<box size="0.02 0.02 0.06"/>', (0.0, 0.0, -0.195))
    low = quadruped(place="on-shank").replace(
        '<link name="LF_shank">', f'<link name="LF_shank">{heel}'
    )
    yield Made(name="a-heel-below-its-foot", urdf=low, wrong="a box is lower than the ball")


# ------------------------------------------------------------------------------------------------------------
# judge


def lowest_m(
    urdf: Path,
    standing: Mapping[str, float],
    posture: Mapping[str, float],
    com_m: Array,
    rotation: Array,
    rpy: Array,
) -> dict[str, float]:
    """The lowest point of every link with shapes over z = 0 [m], by pinocchio and the shapes in the
    file's own text.

    standing, posture: angles by joint, as it stands and as it is posed. com_m, rotation: of the
    point of the body where the whole robot's centre of mass is as it stands, which is what plans
    mean, and of the frame whose z is up, in which the root lies at rpy.
    """
    import pinocchio as pin

    text = urdf.read_text()
    root = ElementTree.fromstring(text)
    for kind in ("floating", "planar"):
        text = text.replace(f'name="root" type="{kind}"', 'name="root" type="fixed"')
    bare = ElementTree.fromstring(text)
    for link in bare.findall("link"):
        for shape in (*link.findall("collision"), *link.findall("visual")):
            link.remove(shape)
    model = pin.buildModelFromXML(
        ElementTree.tostring(bare, encoding="unicode"), pin.JointModelFreeFlyer()
    )
    data, lies = model.createData(), pin.rpy.rpyToMatrix(*rpy)
    q, turn = _posed(model, standing), rotation @ lies
    offset = lies @ pin.centerOfMass(model, data, q)
    q = _posed(model, posture)
    q[3:7] = pin.Quaternion(turn).coeffs()
    q[:3] = com_m - rotation @ offset
    pin.framesForwardKinematics(model, data, q)
    found = {}
    for link in root.findall("link"):
        place = data.oMf[model.getFrameId(link.get("name"), pin.FrameType.BODY)]
        lows = [_low_m(each, place, urdf.parent) for each in link.findall("collision")]
        if lows:
            found[str(link.get("name"))] = min(lows)
    return found


def _posed(model: Any, angles: Mapping[str, float]) -> Array:
    """pinocchio's configuration with the root at the origin."""
    import pinocchio as pin

    q = pin.neutral(model)
    for name, angle in angles.items():
        joint = model.joints[model.getJointId(name)]
        q[joint.idx_q : joint.idx_q + joint.nq] = (
            [angle] if joint.nq == 1 else [np.cos(angle), np.sin(angle)]
        )
    return np.asarray(q)


def _low_m(collision: Any, place: Any, folder: Path) -> float:
    """The least z of a shape: of its support function downwards."""
    import pinocchio as pin

    origin = collision.find("origin")
    xyz, rpy = (
        np.array([float(x) for x in origin.get(key, "0 0 0").split()]) for key in ("xyz", "rpy")
    )
    at = place * pin.SE3(pin.rpy.rpyToMatrix(*rpy), xyz)
    shape = collision.find("geometry")[0]
    down, z = -at.rotation[2], float(at.translation[2])
    radius = float(shape.get("radius", 0.0))
    half = 0.5 * float(shape.get("length", 0.0))
    if shape.tag == "mesh":
        scale = np.array([float(x) for x in shape.get("scale", "1 1 1").split()])
        lines = (folder / shape.get("filename")).read_text().splitlines()
        points = (
            np.array(
                [[float(x) for x in line.split()[1:4]] for line in lines if line.startswith("v ")]
            )
            * scale
        )
        return z - float((points @ down).max())
    if shape.tag == "box":
        return z - float(
            np.abs(down) @ (0.5 * np.array([float(x) for x in shape.get("size").split()]))
        )
    if shape.tag == "cylinder":
        return z - half * abs(float(down[2])) - radius * float(np.hypot(*down[:2]))
    return z - half * abs(float(down[2])) - radius
