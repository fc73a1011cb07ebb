"""Base of simulated worlds: one robot, driven as its servos drive it, physics in steps of a
millisecond.
"""

from __future__ import annotations

from abc import abstractmethod
from collections import deque
from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Self
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement, indent

import numpy as np

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array, read_only
from stancekit.planners.physics import GRAVITY_M_S2
from stancekit.planners.robot import Robot
from stancekit.planners.robot.leg import Actuators, Leg
from stancekit.planners.robot.meshes import Shape, pose_of, shape_elements, write_pose
from stancekit.planners.robot.plausibility import BETWEEN, body_doubts, inertias_of
from stancekit.planners.robot.robot_file import Servo
from stancekit.planners.robot.robot_model import RobotModel

from .world import (
    Drives,
    Imperfections,
    JointBus,
    SoftContact,
    State,
    Terrain,
    WorldKind,
    WorldSettings,
)

_SPECK = 1e-6
"""Share of the robot's mass that a root without one gets: simulators take what weighs nothing for
what never moves."""
_GRAIN = 1e-9
"""The same of any other link, which no simulator takes for anything."""
_SPECK_M = 0.1
"""Its radius of gyration."""
LEAST = 1e-6
"""Share of a link's largest principal moment: the smallest that it may have."""
_ENTRIES = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_FAR_M = 100.0
"""Farther from the world's origin than this simulators, whose meshes have seven digits, get one of
their own, at the robot's start."""
_NEAR = 2
"""Joints between two links of a leg whose shapes, where no SRDF says anything of them, are taken to
overlap."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SimulatedBody:
    """Description of a body that a simulator loads.

    Arguments:
        urdf: text, of links with masses and convex shapes.
        hulls: the contents of the OBJ files that it names.
        base: the root link, whose pose is the body's.
        joints: the legs', in the model's order.
        feet: the links that are feet, and tips_m: their centres in them, shape (N, 3) [m].
        apart: pairs of links that never collide with each other.
        missing: meshes that are not there or cannot be read, which collide with nothing.
    """

    urdf: str
    hulls: Mapping[str, bytes]
    base: str
    joints: tuple[str, ...]
    feet: tuple[str, ...]
    tips_m: Array
    apart: tuple[tuple[str, str], ...]
    missing: tuple[str, ...]


def simulated_body(
    model: RobotModel, *, mass_share: float = 1.0, rotors_kg_m2: Array | None = None
) -> SimulatedBody:
    """The body of a model.

    Arguments:
        mass_share: of all masses and inertias, for robots heavier than their files say.
        rotors_kg_m2: of every joint, shape (J,), added to the inertia of the link that it turns,
            about the joint's axis, and the half across, so that a simulator takes it for a body's;
            for those that know no inertia of rotors.

    Raises:
        InvalidInput: for links with masses or inertias that no body has.
    """
    root = deepcopy(model.tree)
    for unseen in ("visual", "transmission", "gazebo", "material"):
        for parent in list(root.iter()):
            for element in parent.findall(unseen):
                parent.remove(element)
    known = {element for _, element, _ in shape_elements(root)}
    for link in root.findall("link"):  # simulators refuse a file with a shape of another kind
        for element in link.findall("collision"):
            if element not in known:
                link.remove(element)
    joints = tuple(name for leg in model.legs for name in leg.joint_names)
    _write_joints(root, model)
    links = {link.get("name", ""): link for link in root.findall("link")}
    hulls, missing = _hulled(links, [shape for shape in model.shapes if shape.collides])
    for leg in model.legs:
        _shape_foot(links[leg.foot], leg, model)
    children = {joint.find("child").get("link") for joint in root.findall("joint")}  # type: ignore[union-attr]
    base = next(name for name in links if name not in children)
    _check_weights(root, model)
    _weigh(links, base, model.mass_kg, mass_share)
    if rotors_kg_m2 is not None:
        rotors = dict(zip(joints, rotors_kg_m2.tolist(), strict=True))
        for joint in root.findall("joint"):
            if (name := joint.get("name", "")) in rotors:
                _add_rotor(links[joint.find("child").get("link", "")], joint, rotors[name])  # type: ignore[union-attr]
        for inertial in root.findall("link/inertial"):
            _write_principal(inertial)
    for element in (*root.iter("link"), *root.iter("parent"), *root.iter("child")):
        for key, name in element.items():
            element.set(key, _called(name))
    indent(root)  # PyBullet breaks long lines, wherever that is
    return SimulatedBody(
        urdf=ElementTree.tostring(root, encoding="unicode"),
        hulls=hulls,
        base=_called(base),
        joints=joints,
        feet=tuple(leg.foot for leg in model.legs),
        tips_m=np.array([_tip(model, leg) for leg in model.legs]),
        apart=tuple((_called(one), _called(other)) for one, other in _apart(model, set(links))),
        missing=missing,
    )


def _called(link: str) -> str:
    """A link as simulators may call it: MuJoCo takes one with the name world for what never moves."""
    return "world link" if link == "world" else link


def _write_joints(root: Element, model: RobotModel) -> None:
    """Let joints be what the planner takes them for: those of legs have their unit axes, limits,
    damping and friction, all others are fixed. What torque they bear is their drives' to say.
    """
    joints = [
        each
        for leg in model.legs
        for each in zip(leg.joints, leg.chain.axes, leg.turns, strict=True)
    ]
    resisted = zip(*model.resistance, strict=True)
    known = {each[0].name: (*each, *pair) for each, pair in zip(joints, resisted, strict=True)}
    for element in root.findall("joint"):
        for child in list(element):
            if child.tag not in ("parent", "child", "origin"):
                element.remove(child)
        element.set("type", "fixed")
        if (name := element.get("name", "")) in known:
            joint, axis, turns, damping, friction = known[name]
            element.set("type", "continuous" if turns else "revolute")
            SubElement(element, "axis", xyz=" ".join(map(repr, axis.tolist())))
            if not turns:
                ends = {"lower": repr(joint.lower_rad), "upper": repr(joint.upper_rad)}
                SubElement(element, "limit", ends)
            resisting = {"damping": repr(float(damping)), "friction": repr(float(friction))}
            SubElement(element, "dynamics", resisting)


def _apart(model: RobotModel, links: set[str]) -> tuple[tuple[str, str], ...]:
    """Pairs that never collide: the SRDF's; without one those of a leg with no more than one
    joint's link between.
    """
    pairs = {
        (a, b)
        for a, b in (
            sorted(pair) for pair in model.disabled_pairs if len(pair) == 2 and pair <= links
        )
    }
    if not model.disabled_pairs:
        place = {
            name: (mount.leg, mount.joint) for name, mount in model.mounts.items() if name in links
        }
        pairs |= {
            (a, b)
            for a, b in combinations(sorted(place), 2)
            if (place[a][0] == place[b][0] or None in (place[a][0], place[b][0]))
            and abs(place[a][1] - place[b][1]) <= _NEAR
        }
    return tuple(sorted(pairs))


def _tip(model: RobotModel, leg: Leg) -> Array:
    """The foot's centre in the frame of its link, shape (3,) [m]."""
    mount = model.mounts[leg.foot]
    return np.asarray(mount.rotation.T @ (leg.chain.tip_m - mount.origin_m))


def _hulled(
    links: Mapping[str, Element], shapes: list[Shape]
) -> tuple[dict[str, bytes], tuple[str, ...]]:
    """Put hulls in the place of meshes.

    Returns their files by name, and the meshes that are not to be had.
    """
    hulls, missing = dict[str, bytes](), dict[str, None]()
    for name, link in links.items():
        meshes = [shape for shape in shapes if shape.link == name and shape.kind == "mesh"]
        for shape, (collision, mesh) in zip(meshes, list(_meshes(link)), strict=True):
            if shape.corners_m is None:
                missing[mesh.get("filename", "")] = None
                link.remove(collision)
                continue
            mesh.attrib.pop("scale", None)
            for part in shape.parts_m[1:]:
                copied = deepcopy(collision)
                link.append(copied)
                _named(copied, _hull(part), hulls)
            _named(collision, _hull((shape.corners_m, *shape.parts_m)[bool(shape.parts_m)]), hulls)
    return hulls, tuple(missing)


def _meshes(link: Element) -> Iterator[tuple[Element, Element]]:
    for collision in link.findall("collision"):
        geometry = collision.find("geometry")
        if geometry is not None and len(geometry) and geometry[0].tag == "mesh":
            yield collision, geometry[0]


def _named(collision: Element, content: bytes, hulls: dict[str, bytes]) -> None:
    """Let a collision's mesh be a new file with this content."""
    file = f"hull_{len(hulls)}.obj"
    hulls[file] = content
    for mesh in collision.iter("mesh"):
        mesh.set("filename", file)


def _hull(corners: Array) -> bytes:
    """A convex hull as an OBJ file."""
    from scipy.spatial import ConvexHull

    middle = corners.mean(axis=0)
    lines = ["v " + " ".join(f"{x:.9g}" for x in corner) for corner in corners]
    for a, b, c in ConvexHull(corners).simplices:
        out = (
            np.dot(np.cross(corners[b] - corners[a], corners[c] - corners[a]), corners[a] - middle)
            > 0.0
        )
        lines.append(
            "f " + " ".join(str(corner + 1) for corner in ((a, b, c) if out else (a, c, b)))
        )
    return ("\n".join(lines) + "\n").encode()


def _shape_foot(link: Element, leg: Leg, model: RobotModel) -> None:
    """A foot that is a ball by what its link looks like alone collides, too."""
    shapes = [shape for shape in model.shapes if shape.link == leg.foot]
    if leg.radius_m <= 0.0 or any(shape.collides for shape in shapes):
        return
    collision = SubElement(link, "collision")
    SubElement(collision, "origin", {"xyz": " ".join(f"{x:.12g}" for x in _tip(model, leg))})
    SubElement(SubElement(collision, "geometry"), "sphere", {"radius": f"{leg.radius_m:.12g}"})


def _check_weights(root: Element, model: RobotModel) -> None:
    """Raise InvalidInput, with the link, for masses and inertias that no robot has: that is not the
    robot then.
    """
    inertias = inertias_of(root)
    for link, why in body_doubts(root, inertias, model.legs, model.shapes, model.mounts):
        raise InvalidInput(
            f"robot {model.name}: {link}: expected what a body can weigh, got: {why}"
        )
    total = sum(mass for mass, *_ in inertias.values())
    if abs(total - model.mass_kg) > _SPECK * model.mass_kg:
        raise InvalidInput(
            f"robot {model.name}: expected links of {model.mass_kg:.6g} kg in all, as it was "
            "planned for, got "
            f"{total:.6g}"
        )


def _weigh(links: Mapping[str, Element], base: str, mass_kg: float, share: float) -> None:
    """Scale all masses, make inertias ones that bodies have, and give the root, and links that are
    there to have two joints at one place, a speck of mass where they have less; all others that have
    none get a grain, or PyBullet takes them for 1 kg.
    """
    for link in links.values():
        if (mass := link.find("inertial/mass")) is not None and share != 1.0:
            mass.set("value", repr(share * float(mass.get("value", "0"))))
        if (inertia := link.find("inertial/inertia")) is not None:
            inertia_given = share * _inertia(inertia)
            _set_inertia(inertia, inertia_given + _rounded_off(inertia_given) * np.eye(3))
    for name, link in links.items():
        mass = link.find("inertial/mass")
        least = (_SPECK if name == base or link.get(BETWEEN) else _GRAIN) * mass_kg
        if mass is None or float(mass.get("value", "0")) < least:
            for inertial in link.findall("inertial"):
                link.remove(inertial)
            inertial = SubElement(link, "inertial")
            SubElement(inertial, "mass", {"value": repr(least)})
            _set_inertia(SubElement(inertial, "inertia"), least * _SPECK_M**2 * np.eye(3))


def _add_rotor(link: Element, joint: Element, rotor_kg_m2: float) -> None:
    """Add a rotor's inertia about a joint's axis, and the half of it across, which is the least that
    a body has.
    """
    axis = np.array(joint.find("axis").get("xyz", "").split(), dtype=float)  # type: ignore[union-attr]
    turn, _ = pose_of(link.find("inertial/origin"), "inertial")
    axis, inertia = turn.T @ axis, link.find("inertial/inertia")
    rotor = 0.5 * rotor_kg_m2 * (np.eye(3) + np.outer(axis, axis))
    _set_inertia(inertia, _inertia(inertia) + rotor)  # type: ignore[arg-type]


def _write_principal(inertial: Element) -> None:
    """Write an inertia along its principal axes: PyBullet takes those with products, even of 1e-21,
    for other ones, or for none.
    """
    origin, inertia = inertial.find("origin"), inertial.find("inertia")
    turn, place = pose_of(origin, "inertial")
    if origin is not None:
        inertial.remove(origin)
    moments, axes = np.linalg.eigh(_inertia(inertia))  # type: ignore[arg-type]
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    write_pose(inertial, turn @ axes, place)
    _set_inertia(inertia, np.diag(moments))  # type: ignore[arg-type]


def _rounded_off(inertia: Array) -> float:
    """Shortfall of an inertia's principal moments where no body has them: files round the moments
    of thin bodies off.
    """
    small, middle, large = np.linalg.eigvalsh(inertia)
    lacks = max(large - small - middle, LEAST * large - small)
    return float(lacks) if lacks > 0.0 else 0.0


def _inertia(element: Element) -> Array:
    xx, xy, xz, yy, yz, zz = (float(element.get(key, "0")) for key in _ENTRIES)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _set_inertia(element: Element, inertia: Array) -> None:
    for key, value in zip(_ENTRIES, inertia[np.triu_indices(3)], strict=True):
        element.set(key, repr(float(value)))


def local_origin(position_m: Array, far_m: float) -> Array:
    """Whole metres at a place that is so far from the world's origin, 0 nearer to it, shape (3,)."""
    far = bool(np.abs(position_m).max() > far_m)
    return np.round(position_m) if far else np.zeros(3)


PHYSICS_S = 1e-3
_RATE_HZ = 200.0
SPACING_M = 0.025
"""Spacing of the grid that simulators get of heights."""


class SimulatedWorld(JointBus):
    """One robot on one terrain, from nothing: needs no arming, and measures everything.

    Arguments:
        contact: ground that yields, None for hard ground.
    """

    kind: WorldKind = "simulation"
    gravity_m_s2: float

    def __init__(
        self,
        robot: Robot,
        servo: Servo | None = None,
        *,
        rate_hz: float = _RATE_HZ,
        gravity_m_s2: float = GRAVITY_M_S2,
        imperfections: Imperfections = Imperfections(),
        actuators: Actuators | None = None,
        contact: SoftContact | None = None,
    ) -> None:
        self.model = robot.legs_with(servo or robot.servo)
        drives = Drives.of(self.model, actuators)
        super().__init__(robot, servo, drives, rate_hz, senses=True, gravity_m_s2=gravity_m_s2)
        self.imperfections = imperfections
        last = len(robot.limbs) - 1
        if outside := set(imperfections.deaf) - set(range(last + 1)):
            raise InvalidInput(
                f"imperfections.deaf: expected limbs from 0 to {last}, got {min(outside)}"
            )
        if contact is not None:
            contact.check_bears(robot.mass_kg * gravity_m_s2)
        self.contact = contact
        self._substeps = max(1, round(1.0 / (rate_hz * PHYSICS_S)))
        self._perfect = imperfections == Imperfections()
        self._draw = np.random.default_rng(imperfections.seed)
        self._offset = imperfections.offset_rad * self._draw.uniform(-1.0, 1.0, len(self.joints))
        self._late = round(imperfections.delay_s * rate_hz)
        self._felt_late = round(imperfections.felt_delay_s * rate_hz)
        self._waiting: deque[Array] = deque()
        self._felt: deque[Array] = deque()
        self._carried = np.zeros(6)
        self._loads: Array | None = None
        self._origin_m = np.zeros(3)

    @classmethod
    def make(cls, settings: WorldSettings) -> Self:
        """Make the world, see ``JointBus``."""
        if settings.setup is not None:
            raise InvalidInput(f"setup: expected none with a simulation, got {settings.setup}")
        rate_hz = _RATE_HZ if settings.rate_hz is None else settings.rate_hz
        options = {} if settings.contact is None else {"contact": settings.contact}
        return cls(
            settings.robot,
            settings.servo,
            rate_hz=rate_hz,
            gravity_m_s2=settings.gravity_m_s2,
            imperfections=settings.imperfections,
            actuators=settings.actuators,
            **options,
        )

    def connect(
        self, terrain: Terrain, angles_rad: Array, position_m: Array, rotation: Array
    ) -> State:
        """Put the robot, at rest, into this pose over this terrain."""
        self._sent, self._loads = np.array(angles_rad, dtype=float), None
        self._waiting = deque([self._sent] * self._late)
        self._felt = deque([np.zeros((len(self.robot.limbs), 3))] * self._felt_late)
        self._origin_m = local_origin(position_m, _FAR_M)
        place = position_m - self._origin_m
        return self._measured(self._placed(terrain, self._sent - self._offset, place, rotation))

    def preload(self, targets_rad: Array) -> bool:
        """Let joints press from the beginning."""
        self._sent = np.clip(targets_rad, self.drives.lower_rad, self.drives.upper_rad)
        self._waiting = deque([self._sent] * self._late)
        return True

    def carry(self, wrench: Array) -> bool:
        """Let the body bear this beside its weight."""
        self._carried = read_only(wrench, (6,), "wrench")
        return True

    def send(self, targets_rad: Array, loads_rad: Array | None = None) -> None:
        """Send position targets, shape (J,) [rad].

        Arguments:
            loads_rad: sent to drives apart from the angles, which alone are held within limits. The
                first of them were in the targets before.
        """
        period_s = 1.0 / self.rate_hz
        if loads_rad is None:
            self._sent = self.drives.sendable(targets_rad, self._sent, period_s)
        else:
            last = self._sent - (loads_rad if self._loads is None else self._loads)
            wanted = targets_rad - loads_rad
            angles = self.drives.sendable(wanted, last, period_s)
            self._loads = np.array(loads_rad)
            self._sent = np.where(angles == wanted, targets_rad, angles + loads_rad)
        self._waiting.append(self._sent)

    def read(self) -> State:
        """The state after a control period with what was sent."""
        return self._measured(self._advanced(self._waiting.popleft() - self._offset))

    def _measured(self, state: State) -> State:
        """State as the sensors of joints and feet read it, in the world."""
        if self._origin_m.any():
            place, feet = (self._origin_m + at for at in (state.position_m, state.feet_m))
            state = replace(state, position_m=place, feet_m=feet)
        if self._perfect:
            return state
        noise = self.imperfections.noise_rad
        read = state.angles_rad + self._offset
        read = read + noise * self._draw.standard_normal(len(read)) if noise else read
        self._felt.append(self.imperfections.felt_n(state.forces_n, self._draw))
        return replace(state, angles_rad=read, forces_n=self._felt.popleft())

    @abstractmethod
    def _placed(
        self, terrain: Terrain, angles_rad: Array, position_m: Array, rotation: Array
    ) -> State:
        """The robot at rest in this pose over this terrain; the joints' true angles. Position and
        state are from the simulator's own origin, terrain is in the world.
        """

    @abstractmethod
    def _advanced(self, targets_rad: Array) -> State:
        """The state after a control period in which the loops have these targets."""
