"""A robot's MJCF as the URDF and SRDF of the same robot.

MuJoCo compiles the file, with its defaults, includes, units and inferred inertias; the compiled
tree is written as links and joints, so that one form of a robot is read, checked and kept. A key
frame in which the robot stands becomes a group state, and pairs that never touch are disabled.
Angles of a URDF are from the posture in which the file draws the robot: q − qpos0.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array, skew
from ..files.documents import shown
from ..terrain.mesh_file import compiled_mjcf
from .contacts import Index
from .hulls import hull_corners
from .meshes import shape_elements, text_of, write_pose
from .plausibility import BETWEEN

_KEY_FRAMES = ("stand", "standing", "home", "default", "init")
"""Names of key frames in which a robot stands, whatever the height of its base, in this order."""
_FLOOR_M = 0.05
"""A robot stands in another key frame if its lowest point is so near to the plane z = 0 [m]."""
_UPRIGHT = 0.95
"""Cosine of the most that its base leans there."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Mjcf:
    """A robot that was read from an MJCF.

    Arguments:
        urdf, srdf: texts of the same robot.
        hulls: corners of the convex hulls of its meshes, by the number of their shape, each of
            shape (K, 3) [m].
        guesses: choices of the reader that a person may want to correct, one line each.
        doubts: subjects, and what is hard to believe of them.
        gaps: what keeps the robot from being planned for, one line each.
    """

    urdf: str
    srdf: str
    hulls: Mapping[int, Sequence[Array]]
    guesses: tuple[str, ...]
    doubts: tuple[tuple[str, str], ...]
    gaps: tuple[str, ...]

    def doubts_of(self, joints: set[str]) -> list[tuple[str, str]]:
        """The doubts, without those about joints that no leg has.

        Arguments:
            joints: names of the legs' joints.
        """
        words = [(each, each[0].partition(" ")) for each in self.doubts]
        return [each for each, (kind, _, name) in words if kind != "joint" or name in joints]


def read_mjcf(path: Path, name: str = "") -> Mjcf:
    """The robot of an MJCF.

    Arguments:
        name: name of the robot, in place of the file's.

    Raises:
        InvalidInput: in one line, for what MuJoCo does not compile, and for a world whose largest
            tree of bodies is no robot under a free base.
    """
    model, touching, absent = compiled_mjcf(path)
    import mujoco

    reader = _Reader(mujoco=mujoco, model=model, where=str(path), touching=touching)
    reader.doubts += [(f"mesh {mesh}", "no such file, no body") for mesh in absent]
    return reader.read(name or path.stem)


@dataclass(eq=False, kw_only=True)
class _Reader:
    """The parts of one compiled model read so far."""

    mujoco: Any
    model: Any
    where: str
    touching: set[str]
    guesses: list[str] = field(default_factory=list)
    doubts: list[tuple[str, str]] = field(default_factory=list)
    gaps: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        kinds, geoms, model = self.mujoco.mjtJoint, self.mujoco.mjtGeom, self.model
        self.free, self.ball = int(kinds.mjJNT_FREE), int(kinds.mjJNT_BALL)
        self.slide = int(kinds.mjJNT_SLIDE)
        tags = ("sphere", "box", "capsule", "cylinder", "mesh")
        self.tags = {int(getattr(geoms, f"mjGEOM_{tag.upper()}")): tag for tag in tags}
        self.tags[int(geoms.mjGEOM_ELLIPSOID)] = "mesh"
        paired = {*model.pair_geom1.tolist(), *model.pair_geom2.tolist()}
        self.colliding = [
            bool(model.geom_contype[g] or model.geom_conaffinity[g] or g in paired)
            or self._name("geom", g) in self.touching
            for g in range(model.ngeom)
        ]
        self.corners = dict[Element, Array]()

    def read(self, name: str) -> Mjcf:
        """The robot."""
        base = self._base()
        bodies = [b for b in range(self.model.nbody) if base in self._above(b)]
        if not any(self.colliding[g] for b in bodies for g in self._geoms(b)):
            self._take_a_group(bodies)
        root = Element("robot", name=name)
        for b in bodies:
            if b != base:
                root.extend(list(self._joints_to(b)))
            root.append(self._link(b))
        self._tie(root, set(bodies))
        return Mjcf(
            urdf=ElementTree.tostring(root, encoding="unicode"),
            srdf=ElementTree.tostring(self._semantics(base, bodies), encoding="unicode"),
            hulls={
                i: [self.corners[each]]
                for i, (_, each, _) in enumerate(shape_elements(root))
                if each in self.corners
            },
            guesses=tuple(self.guesses),
            doubts=tuple(self.doubts),
            gaps=tuple(self.gaps),
        )

    def _name(self, kind: str, number: int) -> str:
        """The name of a body, joint or geom, or a made one with its number."""
        wanted = getattr(self.mujoco.mjtObj, f"mjOBJ_{kind.upper()}")
        return self.mujoco.mj_id2name(self.model, wanted, number) or f"{kind}_{number}"

    def _above(self, b: int) -> list[int]:
        """A body, and those that carry it, without the world."""
        chain = []
        while b:
            chain.append(b)
            b = int(self.model.body_parentid[b])
        return chain

    def _joints(self, b: int) -> range:
        first = int(self.model.body_jntadr[b])
        return range(first, first + int(self.model.body_jntnum[b]))

    def _geoms(self, b: int) -> range:
        first = int(self.model.body_geomadr[b])
        return range(first, first + int(self.model.body_geomnum[b]))

    def _kind(self, j: int) -> int:
        return int(self.model.jnt_type[j])

    def _base(self) -> int:
        """The body on the world whose tree has most joints of one angle.

        Raises InvalidInput for a world without such a tree, for two robots, and for a base that
        moves along some directions alone.
        """
        model = self.model
        moving = dict[int, int]()
        for b in range(1, model.nbody):
            root = self._above(b)[-1]
            count = sum(self._kind(j) != self.free for j in self._joints(b))
            moving[root] = moving.get(root, 0) + count
        if not moving or not max(moving.values()):
            raise InvalidInput(
                f"{self.where}: expected a robot, got a world of {model.nbody - 1} bodies without "
                "joints"
            )
        base = max(moving, key=lambda root: moving[root])
        called = {root: self._name("body", root) for root in moving}
        twins = [called[b] for b in moving if b != base and 2 * moving[b] > moving[base] > 3]
        if twins:
            raise InvalidInput(
                f"{self.where}: expected one robot, got {len(twins) + 1}: "
                f"{', '.join([called[base], *twins])}"
            )
        if others := [called[b] for b in moving if b != base]:
            self.guesses.append(
                f"the robot is what {called[base]} carries, without {', '.join(others[:6])}"
            )
        kinds = [self._kind(j) for j in self._joints(base)]
        if kinds and kinds != [self.free]:
            along = ", ".join(self._name("joint", j) for j in self._joints(base))
            who = "a robot in a plane" if self.slide in kinds else "an arm"
            raise InvalidInput(
                f"{self.where}: expected a base that moves freely, got {called[base]}, which "
                f"{along} alone {'move' if len(kinds) > 1 else 'moves'}, as in {who}"
            )
        if not kinds:
            self.guesses.append(f"{called[base]} moves freely, for which the file has no joint")
        return base

    def _take_a_group(self, bodies: Sequence[int]) -> None:
        """Let geoms of group 3 be bodies where nothing collides by itself."""
        for b in bodies:
            for g in self._geoms(b):
                self.colliding[g] = int(self.model.geom_group[g]) == 3
        self.guesses.append("geoms of group 3 are its bodies, since none of the file collides")

    def _end(self, b: int) -> Array:
        """The place of a body's link in its own frame: at its last joint, shape (3,) [m]."""
        joints = [j for j in self._joints(b) if self._kind(j) != self.free]
        return np.array(self.model.jnt_pos[joints[-1]] if joints else np.zeros(3))

    def _joints_to(self, b: int) -> Iterator[Element]:
        """The joints of a body, from its parent outward, with links without weight between them."""
        model, name = self.model, self._name("body", b)
        parent = int(model.body_parentid[b])
        turn, place = _matrix(model.body_quat[b]), model.body_pos[b] - self._end(parent)
        carrier, joints = self._name("body", parent), self._joints(b)
        if not joints:
            yield _joint(f"{name}_fixed", "fixed", carrier, name, turn, place)
        for j in joints:
            called, anchor = self._name("joint", j), np.array(model.jnt_pos[j])
            if self._kind(j) in (self.free, self.ball):
                what = "free joint" if self._kind(j) == self.free else "ball"
                raise InvalidInput(
                    f"{self.where}: joint {shown(called)}: expected joints of one angle below the "
                    f"base, got a {what}"
                )
            last = j == joints[-1]
            child = name if last else f"{name}_{called}"
            start = anchor if j == joints[0] else anchor - model.jnt_pos[j - 1]
            joint = _joint(called, "revolute", carrier, child, turn, place + turn @ start)
            SubElement(joint, "axis", xyz=text_of(model.jnt_axis[j]))
            self._limit(joint, j)
            yield joint
            if not last:
                yield Element("link", {"name": child, BETWEEN: "joints"})
            carrier, turn, place = child, np.eye(3), np.zeros(3)

    def _limit(self, joint: Element, j: int) -> None:
        """Write what a joint can do."""
        model, called = self.model, self._name("joint", j)
        zero = float(model.qpos0[model.jnt_qposadr[j]])
        limit = SubElement(joint, "limit", velocity="0", effort=repr(self._torque(j)))
        if self._kind(j) == self.slide:
            joint.set("type", "prismatic")
        elif not model.jnt_limited[j]:
            joint.set("type", "continuous")
        if model.jnt_limited[j]:
            low, high = (model.jnt_range[j] - zero).tolist()
            limit.set("lower", repr(low))
            limit.set("upper", repr(high))
        dof = int(model.jnt_dofadr[j])
        names = ("damping", "frictionloss", "armature")
        moved = [float(getattr(model, f"dof_{each}")[dof].ravel()[0]) for each in names]
        if any(moved):
            damping, friction, armature = map(repr, moved)
            SubElement(joint, "dynamics", damping=damping, friction=friction, armature=armature)
        if abs(zero) > 1e-9:
            self.guesses.append(f"joint {called}: angles are from the file's {zero:g} on")

    def _torque(self, j: int) -> float:
        """The torque of a joint's drives: min(actfrcrange, Σ min(forcerange, gain · ctrlrange
        without bias) · gear) [Nm or N]; 0 where the file limits none.
        """
        model, drives, driven = self.model, list[float](), False
        kinds = self.mujoco.mjtTrn
        on_joints = int(kinds.mjTRN_JOINT), int(kinds.mjTRN_JOINTINPARENT)
        for a in range(model.nu):
            kind, on = int(model.actuator_trntype[a]), int(model.actuator_trnid[a][0])
            if kind not in on_joints or on != j:
                continue
            driven, ends = True, list[float]()
            if model.actuator_forcelimited[a]:
                ends.append(_least(model.actuator_forcerange[a]))
            if not int(model.actuator_biastype[a]) and model.actuator_ctrllimited[a]:
                gain = abs(float(model.actuator_gainprm[a][0]))
                ends.append(_least(model.actuator_ctrlrange[a]) * gain)
            gear = abs(float(model.actuator_gear[a][0]))
            drives.append(min(ends, default=np.inf) * gear if gear else 0.0)
        if model.nu and not driven:
            self.doubts.append((f"joint {self._name('joint', j)}", "no drive moves it alone"))
        most = sum(drives) if drives else np.inf
        if model.jnt_actfrclimited[j]:
            most = min(most, _least(model.jnt_actfrcrange[j]))
        return most if np.isfinite(most) else 0.0

    def _link(self, b: int) -> Element:
        """A body's link: what it weighs and the shapes that collide."""
        model, link, end = self.model, Element("link", name=self._name("body", b)), self._end(b)
        if (mass := float(model.body_mass[b])) > 0.0:
            inertial = SubElement(link, "inertial")
            turn = _matrix(model.body_iquat[b])
            moments = turn @ np.diag(model.body_inertia[b]) @ turn.T
            write_pose(inertial, np.eye(3), model.body_ipos[b] - end)
            SubElement(inertial, "mass", value=repr(mass))
            entries = {
                f"i{'xyz'[i]}{'xyz'[k]}": repr(float(moments[i, k]))
                for i in range(3)
                for k in range(i, 3)
            }
            SubElement(inertial, "inertia", entries)
        for g in self._geoms(b):
            if self.colliding[g] and int(model.geom_type[g]) in self.tags:
                self._shape(link, g, end)
        return link

    def _shape(self, link: Element, g: int, end: Array) -> None:
        """Write the shape of a geom; a flat mesh is left out, and said."""
        model, tag = self.model, self.tags[int(self.model.geom_type[g])]
        size = model.geom_size[g]
        made = Element("collision")
        write_pose(made, _matrix(model.geom_quat[g]), model.geom_pos[g] - end)
        geometry = SubElement(made, "geometry")
        if tag == "sphere":
            SubElement(geometry, tag, radius=repr(float(size[0])))
        elif tag == "box":
            SubElement(geometry, tag, size=text_of(2.0 * size))
        elif tag == "mesh":
            corners = hull_corners(self._points(g))
            if corners is None:
                self.doubts.append((f"link {link.get('name')}", "a flat mesh, which is left out"))
                return
            self.corners[made] = corners
            SubElement(geometry, tag, filename=self._name("geom", g))
        else:
            radius, half = float(size[0]), float(size[1])
            SubElement(geometry, tag, radius=repr(radius), length=repr(2.0 * half))
        link.append(made)

    def _points(self, g: int) -> Array:
        """The vertices of a geom's mesh, or points of its ellipsoid, in its frame, shape (K, 3)
        [m].
        """
        mesh = int(self.model.geom_dataid[g])
        if mesh >= 0:
            first, count = int(self.model.mesh_vertadr[mesh]), int(self.model.mesh_vertnum[mesh])
            return np.array(self.model.mesh_vert[first : first + count], dtype=np.float64)
        around, up = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 16), np.linspace(-1.0, 1.0, 11))
        flat = np.sqrt(1.0 - up**2)
        ball = np.stack([flat * np.cos(around), flat * np.sin(around), up], axis=-1)
        return np.asarray(ball.reshape(-1, 3) * self.model.geom_size[g])

    def _tie(self, root: Element, bodies: set[int]) -> None:
        """Say which joints follow another, and which bodies are tied so that the joints are no
        tree.
        """
        model, kinds = self.model, self.mujoco.mjtEq
        joints = {joint.get("name"): joint for joint in root.findall("joint")}
        for e in np.flatnonzero(model.eq_active0).tolist():
            kind, one, two = (
                int(model.eq_type[e]),
                int(model.eq_obj1id[e]),
                int(model.eq_obj2id[e]),
            )
            if kind == int(kinds.mjEQ_JOINT):
                leader = self._name("joint", two) if two >= 0 else ""
                offset, ratio, *rest = model.eq_data[e][:5].tolist()
                joint = joints.get(self._name("joint", one))
                if joint is None:
                    continue
                if not leader or any(rest):
                    self.gaps.append(
                        f"joint {self._name('joint', one)}: expected a joint of its own or a fixed one, "
                        f"got one that follows {leader or 'a number'}"
                    )
                else:
                    SubElement(
                        joint, "mimic", joint=leader, multiplier=repr(ratio), offset=repr(offset)
                    )
            elif kind in (int(kinds.mjEQ_CONNECT), int(kinds.mjEQ_WELD)):
                if int(model.eq_objtype[e]) == int(self.mujoco.mjtObj.mjOBJ_SITE):
                    one, two = int(model.site_bodyid[one]), int(model.site_bodyid[two])
                if {one, two} & bodies:
                    self.gaps.append(
                        f"links {self._name('body', one)}, {self._name('body', two)}: expected a tree "
                        "of joints, got links that are tied to each other"
                    )
            elif kind == int(kinds.mjEQ_TENDON):
                tendon = self._name("tendon", one)
                self.doubts.append((f"tendon {tendon}", "ties joints, which plans do not know"))

    def _semantics(self, base: int, bodies: Sequence[int]) -> Element:
        """Pairs that never touch, and the key frame in which the robot stands."""
        root = Element("robot", name="robot")
        for one, two in self._apart(bodies):
            names = {"link1": self._name("body", one), "link2": self._name("body", two)}
            SubElement(root, "disable_collisions", names)
        model, mujoco = self.model, self.mujoco
        data, dropped = mujoco.MjData(model), list[str]()
        keys = {self._name("key", k): k for k in range(model.nkey)}
        known = [name for name in _KEY_FRAMES if name in keys]
        for name in dict.fromkeys([*known, *sorted(keys, key=keys.__getitem__)]):
            mujoco.mj_resetDataKeyframe(model, data, keys[name])
            mujoco.mj_kinematics(model, data)
            low = min((self._lowest(data, g) for b in bodies for g in self._geoms(b)), default=0.0)
            if data.xmat[base][8] < _UPRIGHT:
                dropped.append(f"{name} (leans)")
            elif abs(low) > _FLOOR_M and name not in _KEY_FRAMES:
                dropped.append(f"{name} ({low:+.2g} m over z = 0)")
            else:
                state = SubElement(
                    root, "group_state", {"name": "stand", "from": f"key frame {name}"}
                )
                for j in (j for b in bodies for j in self._joints(b) if self._kind(j) != self.free):
                    at = int(model.jnt_qposadr[j])
                    value = repr(float(data.qpos[at] - model.qpos0[at]))
                    SubElement(state, "joint", name=self._name("joint", j), value=value)
                break
        if dropped:
            self.guesses.append(f"no posture to stand in: key frames {', '.join(dropped)}")
        return root

    def _lowest(self, data: Any, g: int) -> float:
        """Height of the lowest point of a geom that collides [m]."""
        if not self.colliding[g]:
            return float(np.inf)
        up, middle = data.geom_xmat[g].reshape(3, 3)[2], float(data.geom_xpos[g][2])
        tag, size = self.tags.get(int(self.model.geom_type[g])), self.model.geom_size[g]
        if tag in ("sphere", "capsule"):
            return middle - float(size[0] + abs(up[2]) * size[1] * (tag == "capsule"))
        if tag == "mesh":
            return middle + float(np.min(self._points(g) @ up))
        box = self.model.geom_aabb[g]
        return middle + float(up @ box[:3] - np.abs(up) @ box[3:])

    def _apart(self, bodies: Sequence[int]) -> Iterator[tuple[int, int]]:
        """Pairs of bodies that the file excludes, or whose geoms never meet by their masks."""
        model = self.model
        excluded = {
            (signature >> 16, signature & 0xFFFF) for signature in model.exclude_signature.tolist()
        }
        masks = [
            np.array([(model.geom_contype[g], model.geom_conaffinity[g]) for g in self._geoms(b)])
            for b in bodies
        ]
        for i, one in enumerate(bodies):
            for k, two in enumerate(bodies[:i]):
                if {(one, two), (two, one)} & excluded or not _meet(masks[i], masks[k]):
                    yield two, one


def _meet(one: Index, two: Index) -> bool:
    """Tell whether any of two sets of contype and conaffinity, shapes (K, 2), lets geoms meet."""
    if not len(one) or not len(two):
        return True  # nothing to look at
    return bool(np.any(one[:, None, 0] & two[None, :, 1] | two[None, :, 0] & one[:, None, 1]))


def _least(limits: Array) -> float:
    """A drive's range both ways; infinite where one end is open."""
    low, high = map(float, limits)
    return min(abs(low), abs(high)) if low < 0.0 < high else 0.0


def _matrix(quaternion: Array) -> Array:
    """R of a unit quaternion w, x, y, z, shape (3, 3)."""
    w, *rest = quaternion / np.linalg.norm(quaternion)
    cross = skew(np.array(rest))
    return np.asarray(np.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross)


def _joint(name: str, kind: str, parent: str, child: str, turn: Array, place: Array) -> Element:
    joint = Element("joint", name=name, type=kind)
    write_pose(joint, turn, place)
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    return joint
