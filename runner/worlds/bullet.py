"""A world in PyBullet (extra ``bullet``): the servo's position loop at every step, the patch's μ in its contacts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.urdf import foot_names, hexapod_urdf
from stancekit.planners.terrain.prism import Solid

from .simulation import PHYSICS_S, SPACING_M, SimulatedWorld, sendable
from .world import Ground, State, Terrain


class BulletWorld(SimulatedWorld):
    """One robot on one terrain in PyBullet. Raises InvalidInput where PyBullet is not installed.

    PyBullet's own position control is a rigid constraint that leaves contact forces to chance; here the joints are
    driven by torques τ = Kp (q* − q) − Kd q̇, as a servo does it. Friction coefficients multiply: the robot's is 1.
    """

    name = "bullet"

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        try:
            import pybullet
        except ImportError:
            raise InvalidInput(
                "world: expected PyBullet, it is not installed: pip install 'stancekit[bullet]' (Linux, Python 3.11)"
            ) from None
        self._bullet: Any = pybullet
        self._urdf = hexapod_urdf(self.robot, self.servo, rotors_in_links=True)  # PyBullet knows no rotors
        self._client = pybullet.connect(pybullet.DIRECT)

    def reset(self, terrain: Terrain, angles_rad: Array, position_m: Array, rotation: Array) -> State:
        """Put the robot, at rest, into this pose over this terrain."""
        self._begin()
        self._lay(terrain)
        bullet, client = self._bullet, self._client
        self._robot = self._loaded()
        bullet.resetBasePositionAndOrientation(
            self._robot, list(position_m), _quaternion(rotation), physicsClientId=client
        )
        for joint, angle in zip(self._motors, angles_rad, strict=True):
            bullet.resetJointState(self._robot, joint, float(angle), physicsClientId=client)
        self._sent, self._time = np.array(angles_rad, dtype=float), 0.0
        return self._state(np.zeros((len(self._feet), 3)), 0.0, np.zeros(len(self._motors)))

    def step(self, targets_rad: Array) -> State:
        """One control period with these position targets, shape (J,) [rad]."""
        bullet, client, servo = self._bullet, self._client, self.servo
        targets = sendable(targets_rad, self._sent, servo, 1.0 / self.rate_hz)
        with self.latch.sending():
            self._sent = targets
        forces, bump = np.zeros((len(self._feet), 3)), 0.0
        for _ in range(self._substeps):
            angles, rates = self._joint_state()
            torques = servo.stiffness_nm_rad * (self._sent - angles) - servo.damping_nms_rad * rates
            torques = np.clip(torques, -servo.torque_nm, servo.torque_nm)
            bullet.setJointMotorControlArray(
                self._robot, self._motors, bullet.TORQUE_CONTROL, forces=torques.tolist(), physicsClientId=client
            )
            bullet.stepSimulation(physicsClientId=client)
            bump += self._contacts(forces)
        self._time += self._substeps * PHYSICS_S
        return self._state(forces / self._substeps, bump / self._substeps, torques)

    def close(self) -> None:
        """Disconnect from the physics server."""
        if self._client >= 0:
            self._bullet.disconnect(physicsClientId=self._client)
            self._client = -1

    def _begin(self) -> None:
        """An empty world. The order of contacts is fixed, or two runs differ."""
        bullet, client = self._bullet, self._client
        bullet.resetSimulation(physicsClientId=client)
        bullet.setGravity(0.0, 0.0, -self.gravity_m_s2, physicsClientId=client)
        bullet.setPhysicsEngineParameter(
            fixedTimeStep=PHYSICS_S, numSolverIterations=150, deterministicOverlappingPairs=1, enableConeFriction=1,
            physicsClientId=client,
        )  # fmt: skip

    def _lay(self, terrain: Terrain) -> None:
        """Every patch as a static convex body, or heights as a field, with their friction."""
        bullet, client = self._bullet, self._client
        if isinstance(terrain, Ground):
            x, y, heights = terrain.even(SPACING_M)
            shape = bullet.createCollisionShape(
                bullet.GEOM_HEIGHTFIELD, meshScale=[x[1] - x[0], y[1] - y[0], 1.0],
                heightfieldData=heights.T.ravel().tolist(), numHeightfieldRows=len(x), numHeightfieldColumns=len(y),
                physicsClientId=client,
            )  # fmt: skip
            middle = [x.mean(), y.mean(), 0.5 * (heights.min() + heights.max())]  # where PyBullet has its origin
            self._still(shape, middle, terrain.friction)
            return
        for patch in terrain:
            solid = Solid.behind(patch)
            middle = solid.corners.mean(axis=0)
            shape = bullet.createCollisionShape(
                bullet.GEOM_MESH, vertices=(solid.corners - middle).tolist(), indices=solid.triangles.ravel().tolist(),
                physicsClientId=client,
            )  # fmt: skip
            self._still(shape, middle.tolist(), patch.friction)

    def _still(self, shape: int, middle: Sequence[float], friction: float) -> None:
        """A body that does not move."""
        bullet, client = self._bullet, self._client
        body = bullet.createMultiBody(0.0, shape, basePosition=list(middle), physicsClientId=client)
        bullet.changeDynamics(
            body, -1, lateralFriction=friction, rollingFriction=0.0, spinningFriction=0.0, restitution=0.0,
            physicsClientId=client,
        )  # fmt: skip

    def _loaded(self) -> int:
        """The robot, its links not merged, its joints free of PyBullet's own motors and damping."""
        import tempfile
        from pathlib import Path

        bullet, client = self._bullet, self._client
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "robot.urdf"
            path.write_text(self._urdf, encoding="utf-8")
            robot = bullet.loadURDF(str(path), flags=bullet.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client)
        names = {}
        for index in range(bullet.getNumJoints(robot, physicsClientId=client)):
            info = bullet.getJointInfo(robot, index, physicsClientId=client)
            names[info[1].decode()] = names[info[12].decode()] = index
        self._motors = [names[joint] for joint in self.joints]
        self._feet = [names[foot] for foot in foot_names(self.robot)]
        bullet.setJointMotorControlArray(
            robot, self._motors, bullet.VELOCITY_CONTROL, forces=[0.0] * len(self._motors), physicsClientId=client
        )
        for link in range(-1, bullet.getNumJoints(robot, physicsClientId=client)):
            bullet.changeDynamics(
                robot, link, lateralFriction=1.0, rollingFriction=0.0, spinningFriction=0.0, restitution=0.0,
                linearDamping=0.0, angularDamping=0.0, jointDamping=0.0, physicsClientId=client,
            )  # fmt: skip
        return int(robot)

    def _joint_state(self) -> tuple[Array, Array]:
        found = self._bullet.getJointStates(self._robot, self._motors, physicsClientId=self._client)
        return np.array([state[0] for state in found]), np.array([state[1] for state in found])

    def _contacts(self, forces: Array) -> float:
        """Add the forces of all contacts to their feet; the force on anything else is returned [N]."""
        bump = 0.0
        for contact in self._bullet.getContactPoints(bodyA=self._robot, physicsClientId=self._client):
            normal, first, second = (np.array(contact[k]) for k in (7, 11, 13))
            force = contact[9] * normal + contact[10] * first + contact[12] * second
            if contact[3] in self._feet:
                forces[self._feet.index(contact[3])] += force
            else:
                bump += float(np.linalg.norm(force))
        return bump

    def _state(self, forces: Array, bump: float, torques: Array) -> State:
        bullet, client = self._bullet, self._client
        position, quaternion = bullet.getBasePositionAndOrientation(self._robot, physicsClientId=client)
        velocity = bullet.getBaseVelocity(self._robot, physicsClientId=client)
        angles, rates = self._joint_state()
        links = bullet.getLinkStates(self._robot, self._feet, computeForwardKinematics=1, physicsClientId=client)
        return State(
            time_s=self._time,
            position_m=np.array(position),
            rotation=np.array(bullet.getMatrixFromQuaternion(quaternion)).reshape(3, 3),
            velocity=np.concatenate(velocity),
            angles_rad=angles,
            rates_rad_s=rates,
            torques_nm=torques,
            feet_m=np.array([link[4] for link in links]),
            forces_n=forces,
            bump_n=bump,
            sent_rad=self._sent.copy(),
        )


def _quaternion(rotation: Array) -> list[float]:
    """(x, y, z, w) of a rotation matrix."""
    from scipy.spatial.transform import Rotation

    return [float(v) for v in Rotation.from_matrix(rotation).as_quat()]
