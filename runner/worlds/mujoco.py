"""A world in MuJoCo (extra ``mujoco``): position actuators with the servo's gains, elliptic cones, the patch's μ."""

from __future__ import annotations

from typing import Any

import numpy as np

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.urdf import foot_names, hexapod_urdf
from stancekit.planners.terrain.prism import Solid

from .simulation import PHYSICS_S, SPACING_M, SimulatedWorld, sendable
from .world import Ground, State, Terrain

CONTACT_S, CONTACT_DAMPING = 0.004, 1.0
"""Time constant and damping ratio of a contact (solref)."""
STIFF = 100.0
"""Friction rows are this much harder than normal ones (impratio): feet under load creep less."""
UNDER_M = 0.5
"""How deep a field of heights is below its lowest place."""
ICE = 1e-6
"""At and below this friction a contact has no friction rows at all."""


class MujocoWorld(SimulatedWorld):
    """One robot on one terrain in MuJoCo. Raises InvalidInput where MuJoCo is not installed."""

    name = "mujoco"

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        try:
            import mujoco
        except ImportError:
            raise InvalidInput("world: expected MuJoCo, it is not installed: pip install 'stancekit[mujoco]'") from None
        self._mujoco = mujoco
        self._model: Any = None
        self._data: Any = None

    def reset(self, terrain: Terrain, angles_rad: Array, position_m: Array, rotation: Array) -> State:
        """Put the robot, at rest, into this pose over this terrain."""
        self._model = self._compiled(terrain)
        self._data = self._mujoco.MjData(self._model)
        quaternion = np.empty(4)
        self._mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(rotation).ravel())
        self._data.qpos[:7] = [*position_m, *quaternion]
        self._data.qpos[7:] = angles_rad
        self._sent = np.array(angles_rad, dtype=float)
        self._feet = [self._model.body(name).id for name in foot_names(self.robot)]
        self._mujoco.mj_forward(self._model, self._data)
        return self._state(np.zeros((len(self._feet), 3)), 0.0)

    def step(self, targets_rad: Array) -> State:
        """One control period with these position targets, shape (J,) [rad]."""
        targets = sendable(targets_rad, self._sent, self.servo, 1.0 / self.rate_hz)
        with self.latch.sending():
            self._sent = self._data.ctrl[:] = targets
        forces, bump = np.zeros((len(self._feet), 3)), 0.0
        for _ in range(self._substeps):
            self._mujoco.mj_step(self._model, self._data)
            bump += self._contacts(forces)
        return self._state(forces / self._substeps, bump / self._substeps)

    def close(self) -> None:
        """Drop the model."""
        self._model = self._data = None

    def _compiled(self, terrain: Terrain) -> Any:
        kinds = self._mujoco
        spec = kinds.MjSpec.from_string(hexapod_urdf(self.robot, self.servo))
        spec.compiler.fusestatic = False  # or the body, and the feet, are merged into their parents
        spec.option.timestep = PHYSICS_S
        spec.option.gravity = [0.0, 0.0, -self.gravity_m_s2]
        spec.option.integrator = kinds.mjtIntegrator.mjINT_IMPLICITFAST
        spec.option.cone = kinds.mjtCone.mjCONE_ELLIPTIC
        spec.option.impratio = STIFF
        spec.body("body").add_freejoint()
        for geom in spec.geoms:
            geom.contype, geom.conaffinity = 1, 0  # limbs meet the terrain, not each other
        self._lay(spec, terrain)
        for joint in self.joints:
            spec.joint(joint).armature = self.servo.rotor_kg_m2
            actuator = spec.add_actuator(name=joint, target=joint, trntype=kinds.mjtTrn.mjTRN_JOINT)
            actuator.set_to_position(kp=self.servo.stiffness_nm_rad, kv=self.servo.damping_nms_rad)
            actuator.forcelimited, actuator.forcerange = True, [-self.servo.torque_nm, self.servo.torque_nm]
        return spec.compile()

    def _lay(self, spec: Any, terrain: Terrain) -> None:
        """Every patch as a static convex body, or heights as a field, whose friction counts, not the larger of two."""
        kinds = self._mujoco.mjtGeom
        contact: dict[str, Any] = {
            "contype": 0, "conaffinity": 1, "priority": 1,
            "solref": [CONTACT_S, CONTACT_DAMPING], "solimp": [0.95, 0.99, 0.001, 0.5, 2.0],
        }  # fmt: skip
        if isinstance(terrain, Ground):
            x, y, heights = terrain.even(SPACING_M)
            low, high = float(heights.min()), max(float(heights.max()), float(heights.min()) + 1e-6)
            spec.add_hfield(
                name="ground", nrow=len(y), ncol=len(x), size=[np.ptp(x) / 2, np.ptp(y) / 2, high - low, UNDER_M],
                userdata=((heights.T - low) / (high - low)).ravel().tolist(),
            )  # fmt: skip
            middle = [float(x.mean()), float(y.mean()), low]
            spec.worldbody.add_geom(
                type=kinds.mjGEOM_HFIELD, hfieldname="ground", pos=middle, **rubbing(terrain.friction), **contact
            )
            return
        for index, patch in enumerate(terrain):
            spec.add_mesh(name=f"patch_{index}", uservert=Solid.behind(patch).corners.ravel())
            spec.worldbody.add_geom(
                type=kinds.mjGEOM_MESH, meshname=f"patch_{index}", **rubbing(patch.friction), **contact
            )

    def _contacts(self, forces: Array) -> float:
        """Add the forces of all contacts to their feet; the force on anything else is returned [N]."""
        bump, local = 0.0, np.zeros(6)
        for index in range(self._data.ncon):
            contact = self._data.contact[index]
            self._mujoco.mj_contactForce(self._model, self._data, index, local)
            force = contact.frame.reshape(3, 3).T @ local[:3]  # on the second body
            first, second = (self._model.geom_bodyid[geom] for geom in (contact.geom1, contact.geom2))
            body, sign = (second, 1.0) if first == 0 else (first, -1.0)
            if body in self._feet:
                forces[self._feet.index(body)] += sign * force
            else:
                bump += float(np.linalg.norm(force))
        return bump

    def _state(self, forces: Array, bump: float) -> State:
        data = self._data
        rotation = data.body("body").xmat.reshape(3, 3).copy()
        return State(
            time_s=float(data.time),
            position_m=data.qpos[:3].copy(),
            rotation=rotation,
            velocity=np.concatenate([data.qvel[:3], rotation @ data.qvel[3:6]]),
            angles_rad=data.qpos[7:].copy(),
            rates_rad_s=data.qvel[6:].copy(),
            torques_nm=data.actuator_force.copy(),
            feet_m=data.xpos[self._feet].copy(),
            forces_n=forces,
            bump_n=bump,
            sent_rad=self._sent.copy(),
        )


def rubbing(friction: float) -> dict[str, Any]:
    """Friction of a geometry; ice has none."""
    return {"condim": 3 if friction > ICE else 1, "friction": [max(friction, ICE), 0.0, 0.0]}
