"""A world in MuJoCo (extra ``robots``): position actuators with the servo's gains, elliptic cones,
the patch's μ.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.errors import installed
from stancekit.planners.files.arrays import Array, cross

from .simulation import PHYSICS_S, SPACING_M, SimulatedWorld, simulated_body
from .world import Ground, State, Terrain, points

_CONTACT_S, _CONTACT_DAMPING = 0.004, 1.0
"""Time constant and damping ratio of a contact (solref)."""
_SHAPE = 0.001, 0.5, 2.0
"""Growth of a contact's impedance with its depth (the rest of solimp)."""
_STIFF = 100.0
"""Friction rows are this much harder than normal ones (impratio): feet under load creep less."""
_UNDER_M = 0.5
"""Depth of a field of heights below its lowest place."""
_NET_FORCE = 3
"""Kind of contact sensor that adds forces up, in the world's axes."""
TERRAIN, ROBOT = 1, 2
"""Bits of what meets what: links meet the terrain and each other."""
_CREEP = 2.5e-6
"""Speed at which feet creep under a force along soft ground [m/s per N], as slowly as on the
world's own."""
_IMPEDANCES = (1e-4, 0.9999)
"""MuJoCo's bounds of d in R = (1 − d) / d · Â."""
ICE = 1e-6
"""At and below this friction a contact has no friction rows at all."""


def mujoco_module() -> Any:
    """The module mujoco.

    Raises InvalidInput where it is not installed.
    """
    return installed("mujoco", "world", "MuJoCo", "simulations", "robots")


class MujocoWorld(SimulatedWorld):
    """One robot on one terrain in MuJoCo.

    Raises InvalidInput where MuJoCo is not installed.
    """

    name = "mujoco"

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._mujoco = mujoco_module()
        self.body = simulated_body(self.model, mass_share=self.imperfections.mass_share)
        self._touching: tuple[tuple[str, str], ...] | None = None
        self._model: Any = None
        self._data: Any = None
        self._views: tuple[Array, ...] = ()
        self._sensed = np.zeros((0, 4))

    def _placed(
        self, terrain: Terrain, angles_rad: Array, position_m: Array, rotation: Array
    ) -> State:
        self._model = self._compiled(terrain)
        self._data = self._mujoco.MjData(self._model)
        # its own memory, which changes with every step
        self._views = tuple(
            getattr(self._data, name) for name in ("qpos", "qvel", "xmat", "xpos", "actuator_force")
        )
        self._sensed = self._data.sensordata.reshape(-1, 4)  # of a foot: its contacts, their force
        quaternion = np.empty(4)
        self._mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(rotation).ravel())
        self._data.qpos[:7] = [*position_m, *quaternion]
        joints = [self._model.joint(name) for name in self.joints]
        self._angles = np.array([int(joint.qposadr[0]) for joint in joints])
        self._rates = np.array([int(joint.dofadr[0]) for joint in joints])
        self._data.qpos[self._angles] = angles_rad
        self._base = self._model.body(self.body.base).id
        self._feet = np.array([self._model.body(name).id for name in self.body.feet])
        self._bodies = np.array(self._model.geom_bodyid)
        self._tips = self.body.tips_m[:, :, None]
        self._fades = bool(self.drives.fading.any())
        self._foot = np.full(self._model.nbody, -1)
        self._foot[self._feet] = np.arange(len(self._feet))
        self._mujoco.mj_forward(self._model, self._data)
        return self._state(np.zeros((len(self._feet), 3)), 0.0)

    def _advanced(self, targets_rad: Array) -> State:
        self._data.ctrl[:] = targets_rad
        felt, bump, sensed = np.zeros((len(self._feet), 4)), 0.0, self._sensed
        of_feet = sensed[:, 0]  # contacts
        self._data.xfrc_applied[self._base] = self._on_body()
        for _ in range(self._substeps):
            if self._fades:
                ranges = self._model.actuator_forcerange
                ranges[:, 0], ranges[:, 1] = self.drives.torque_range(self._data.qvel[self._rates])
            self._step()
            felt += sensed
            if self._data.ncon > sum(of_feet.tolist()):
                bump += self._bumped()
        return self._state(felt[:, 1:] / self._substeps, bump / self._substeps)

    def close(self) -> None:
        """Drop the model."""
        self._model = self._data = None
        self._views, self._sensed = (), np.zeros((0, 4))

    def _step(self) -> None:
        """A step of physics.

        A foot's points on soft ground share its stiffness and damping, so that those of heights,
        which MuJoCo meets cell by cell, are no stiffer than one.
        """
        if self.contact is None:
            self._mujoco.mj_step(self._model, self._data)
            return
        self._mujoco.mj_step1(self._model, self._data)
        data, contact = self._data, self._data.contact
        feet = self._under(self._bodies[contact.geom])
        counts = np.bincount(feet[feet >= 0], minlength=len(self._feet))
        for foot in np.flatnonzero(counts > 1):
            of_foot = np.flatnonzero(feet == foot)
            count = points(-contact.dist[of_foot], contact.frame[of_foot, :3])
            for index in of_foot[contact.efc_address[of_foot] >= 0]:
                rows = slice(
                    contact.efc_address[index], contact.efc_address[index] + contact.dim[index]
                )
                data.efc_R[rows] *= count
                data.efc_D[rows] /= count
        self._mujoco.mj_step2(self._model, data)

    def _on_body(self) -> Array:
        """Force on the base's own centre of mass and moment: what is carried, which acts at the
        robot's, and pushes.
        """
        wrench = np.array(self._carried)
        if not (self.imperfections.pushes or wrench.any()):
            return wrench
        arm = self._data.subtree_com[self._base] - self._data.xipos[self._base]
        wrench[3:] += cross(arm, self._carried[:3])
        wrench[:3] += self.imperfections.pushed_n(float(self._data.time))
        return wrench

    def _compiled(self, terrain: Terrain) -> Any:
        spec, kinds = self.scene(terrain, self._origin_m), self._mujoco
        wanted = kinds.mjtConDataField.mjCONDATA_FOUND, kinds.mjtConDataField.mjCONDATA_FORCE
        for foot in self.body.feet:
            spec.add_sensor(
                name=f"felt by {foot}",
                type=kinds.mjtSensor.mjSENS_CONTACT,
                objtype=kinds.mjtObj.mjOBJ_BODY,
                objname="world",
                reftype=kinds.mjtObj.mjOBJ_BODY,
                refname=foot,
                intprm=[sum(1 << int(field) for field in wanted), _NET_FORCE, 1],
            )
        return spec.compile() if self.contact is None else self._softened(spec)

    def scene(self, terrain: Terrain, origin_m: Array) -> Any:
        """The robot over a terrain, an MjSpec before compilation, with its origin at this place of
        the terrain, shape (3,) [m].
        """
        spec = self._spec(
            self.body.apart if self._touching is None else (*self.body.apart, *self._touching)
        )
        if self._touching is None:
            self._touching = self._touching_at_rest(spec.compile())
            spec = self._spec((*self.body.apart, *self._touching))
        self._lay(spec, terrain, origin_m)
        return spec

    def _spec(self, apart: Sequence[tuple[str, str]]) -> Any:
        """The robot alone.

        Arguments:
            apart: pairs of its links that never collide.
        """
        kinds, drives = self._mujoco, self.drives
        spec = kinds.MjSpec.from_string(self.body.urdf, assets=dict(self.body.hulls))
        spec.compiler.fusestatic = False  # or the body, and the feet, are merged into their parents
        spec.option.timestep = PHYSICS_S
        spec.option.gravity = [0.0, 0.0, -self.gravity_m_s2]
        spec.option.integrator = kinds.mjtIntegrator.mjINT_IMPLICITFAST
        spec.option.cone = kinds.mjtCone.mjCONE_ELLIPTIC
        spec.option.impratio = _STIFF
        spec.body(self.body.base).add_freejoint()
        for geom in spec.geoms:
            geom.density = 0.0  # or links without a mass in the file get one of their shapes
            geom.contype, geom.conaffinity = TERRAIN | ROBOT, ROBOT
        for first, second in apart:
            spec.add_exclude(bodyname1=first, bodyname2=second)
        for i, joint in enumerate(self.joints):
            stiffness = self.imperfections.stiffness_share * drives.stiffness_nm_rad[i]
            spec.joint(joint).armature = drives.rotor_kg_m2[i]
            actuator = spec.add_actuator(name=joint, target=joint, trntype=kinds.mjtTrn.mjTRN_JOINT)
            actuator.set_to_position(kp=stiffness, kv=drives.damping_nms_rad[i])
            actuator.forcelimited, actuator.forcerange = (
                True,
                [-drives.torque_nm[i], drives.torque_nm[i]],
            )
        return spec

    def _softened(self, spec: Any) -> Any:
        """The model with ground that yields as ``SoftContact`` says: f = k d + b v, stepped
        implicitly.

        MuJoCo's row is R f + a = −b' v − k' r with R = (1 − d) / d · Â, where Â is the inverse mass
        that it counts the contact with. With 1 / R = h b + h² k, k' = R k and b' = R (b + h k) that
        is f = k (r + h v⁺) + b v⁺ with the velocity at the end of the step. Its stiffness and
        damping are called −k' d and −b' d (solref) for a constant d (solimp). Â is made the same
        for all feet; friction rows get an R of their own (impratio), or feet would creep.
        """
        assert self.contact is not None
        stiffness = self.contact.stiffness_n_m
        damping = self.contact.damped(self.robot.mass_kg, len(self.robot.limbs))
        model = spec.compile()
        feet = [model.body(name).id for name in self.body.feet]
        light = float(np.mean(model.body_invweight0[feet, 0]))
        heavy = light * (PHYSICS_S * damping + PHYSICS_S**2 * stiffness)
        impedance = float(np.clip(heavy / (1.0 + heavy), *_IMPEDANCES))
        unit, damped = (1.0 - impedance) * light, damping + PHYSICS_S * stiffness
        for geom in spec.worldbody.geoms:
            geom.solref = [-unit * stiffness, -unit * damped]
            geom.solimp = [impedance, impedance, *_SHAPE]
        spec.option.impratio = max(_STIFF, 1.0 / (_CREEP * damped))
        model = spec.compile()
        model.body_invweight0[feet, 0] = light
        model.opt.disableflags |= (
            self._mujoco.mjtDisableBit.mjDSBL_ISLAND
        )  # islands have copies of R, see ``_step``
        return model

    def _touching_at_rest(self, model: Any) -> tuple[tuple[str, str], ...]:
        """Pairs of links whose shapes overlap in the posture that the robot stands in: they are
        drawn so.
        """
        data = self._mujoco.MjData(model)
        for leg in self.model.legs:
            for name, angle in zip(leg.joint_names, leg.stance_rad, strict=True):
                data.qpos[model.joint(name).qposadr[0]] = angle
        self._mujoco.mj_forward(model, data)
        geoms = {tuple(sorted((contact.geom1, contact.geom2))) for contact in data.contact}
        bodies = sorted(
            {tuple(model.body(model.geom_bodyid[geom]).name for geom in pair) for pair in geoms}
        )
        return tuple((first, second) for first, second in bodies)

    def _lay(self, spec: Any, terrain: Terrain, origin_m: Array) -> None:
        """Every patch as a static convex body, or heights as a field, whose friction counts, not
        the larger of two.
        """
        kinds = self._mujoco.mjtGeom
        contact: dict[str, Any] = {
            "contype": 0,
            "conaffinity": TERRAIN,
            "priority": 1,
            "solref": [_CONTACT_S, _CONTACT_DAMPING],
            "solimp": [0.95, 0.99, *_SHAPE],
        }
        if isinstance(terrain, Ground):
            x, y, heights = terrain.even(SPACING_M)
            low, high = float(heights.min()), max(float(heights.max()), float(heights.min()) + 1e-6)
            spec.add_hfield(
                name="ground",
                nrow=len(y),
                ncol=len(x),
                size=[np.ptp(x) / 2, np.ptp(y) / 2, high - low, _UNDER_M],
                userdata=((heights.T - low) / (high - low)).ravel().tolist(),
            )
            middle = (np.array([x.mean(), y.mean(), low]) - origin_m).tolist()
            spec.worldbody.add_geom(
                type=kinds.mjGEOM_HFIELD,
                hfieldname="ground",
                pos=middle,
                **_rubbing(terrain.friction),
                **contact,
            )
            return
        for index, patch in enumerate(terrain):
            spec.add_mesh(name=f"patch_{index}", uservert=(patch.solid.corners - origin_m).ravel())
            spec.worldbody.add_geom(
                type=kinds.mjGEOM_MESH,
                meshname=f"patch_{index}",
                **_rubbing(patch.friction),
                **contact,
            )

    def _bumped(self) -> float:
        """Sum of the forces of the terrain on anything but feet, and of links on each other [N]."""
        contact, force = self._data.contact, np.zeros(6)
        total, feet = 0.0, self._under(self._bodies[contact.geom])
        for index in np.flatnonzero(feet < 0).tolist():
            self._mujoco.mj_contactForce(self._model, self._data, index, force)
            total += float(np.linalg.norm(force[:3]))
        return total

    def _under(self, pairs: NDArray[np.int_]) -> NDArray[np.int_]:
        """Foot that is on the terrain in each pair of bodies, −1 where none is."""
        feet = self._foot[np.where(pairs[:, 0] == 0, pairs[:, 1], pairs[:, 0])]
        feet[pairs.all(axis=1)] = -1
        return np.asarray(feet)

    def _state(self, forces: Array, bump: float) -> State:
        data, (places, rates, turned, origins, torques) = self._data, self._views
        rotation = turned[self._base].reshape(3, 3).copy()
        turns = turned[self._feet].reshape(-1, 3, 3)
        return State(
            time_s=float(data.time),
            position_m=places[:3].copy(),
            rotation=rotation,
            velocity=np.concatenate([rates[:3], rotation @ rates[3:6]]),
            angles_rad=places[self._angles],
            rates_rad_s=rates[self._rates],
            torques_nm=torques.copy(),
            feet_m=origins[self._feet] + (turns @ self._tips)[..., 0],
            forces_n=forces,
            bump_n=bump,
            sent_rad=self._sent.copy(),
        )


def _rubbing(friction: float) -> dict[str, Any]:
    """Friction of a geometry; ice has none."""
    return {"condim": 3 if friction > ICE else 1, "friction": [max(friction, ICE), 0.0, 0.0]}
