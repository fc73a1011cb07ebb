"""A world in PyBullet (extra ``catalogue``): the servo's position loop at every step, the patch's μ
in its contacts.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from inspect import isbuiltin
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from stancekit.planners.errors import installed
from stancekit.planners.files.arrays import Array, cross

from .simulation import PHYSICS_S, SPACING_M, SimulatedWorld, simulated_body
from .world import Ground, State, Terrain, points


class BulletWorld(SimulatedWorld):
    """One robot on one terrain in PyBullet.

    Raises InvalidInput where PyBullet is not installed.

    PyBullet's own position control is a rigid constraint that leaves contact forces to chance; here
    the joints are driven by torques τ = Kp (q* − q) − Kd q̇, as a servo does it. Friction
    coefficients multiply: the robot's is 1.
    """

    name = "bullet"
    lacks = "rotors count as parts of links"

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        pybullet = installed(
            "pybullet", "world", "PyBullet", "bullet (Linux, Python 3.11)", "catalogue"
        )
        self.body = simulated_body(  # PyBullet knows no rotors
            self.model,
            mass_share=self.imperfections.mass_share,
            rotors_kg_m2=self.drives.rotor_kg_m2,
        )
        client = pybullet.connect(pybullet.DIRECT)
        self._bullet: Any = SimpleNamespace(  # every call with the number of this client
            **{
                name: partial(each, physicsClientId=client) if isbuiltin(each) else each
                for name, each in vars(pybullet).items()
            }
        )

    def _placed(
        self, terrain: Terrain, angles_rad: Array, position_m: Array, rotation: Array
    ) -> State:
        self._begin()
        self._robot = self._loaded()
        self._part_at_rest()
        self._counts = np.zeros(len(self._feet))
        self._soften(np.ones(len(self._feet)))
        self._lay(terrain)
        bullet = self._bullet
        bullet.resetBasePositionAndOrientation(
            self._robot,
            (position_m + rotation @ self._heart_m).tolist(),
            Rotation.from_matrix(rotation @ self._heart).as_quat().tolist(),
        )
        self._place_joints(angles_rad)
        self._time = 0.0
        return self._state(np.zeros((len(self._feet), 3)), 0.0, np.zeros(len(self._motors)))

    def _advanced(self, targets_rad: Array) -> State:
        bullet, drives = self._bullet, self.drives
        stiffness = self.imperfections.stiffness_share * drives.stiffness_nm_rad
        forces, bump = np.zeros((len(self._feet), 3)), 0.0
        push = self.imperfections.pushed_n(self._time)
        carried = self._carried.any()
        resisted = bool(drives.viscous_nms_rad.any() or drives.dry_nm.any())
        for _ in range(self._substeps):
            if carried:
                self._bear()
            if push.any():  # a step forgets it
                at, _turn = bullet.getBasePositionAndOrientation(self._robot)
                bullet.applyExternalForce(self._robot, -1, push.tolist(), at, bullet.WORLD_FRAME)
            angles, rates = self._joint_state()
            torques = stiffness * (targets_rad - angles) - drives.damping_nms_rad * rates
            torques = np.clip(torques, *drives.torque_range(rates))
            bullet.setJointMotorControlArray(
                self._robot,
                self._motors,
                bullet.TORQUE_CONTROL,
                forces=torques.tolist(),
            )
            if resisted:  # as motors that hold still with no more than this: none turns them back
                bullet.setJointMotorControlArray(
                    self._robot,
                    self._motors,
                    bullet.VELOCITY_CONTROL,
                    forces=(drives.viscous_nms_rad * np.abs(rates) + drives.dry_nm).tolist(),
                )
            bullet.stepSimulation()
            bump += self._contacts(forces)
        self._time += self._substeps * PHYSICS_S
        return self._state(forces / self._substeps, bump / self._substeps, torques)

    def _bear(self) -> None:
        """Put what is carried on the body for one step: a force at the robot's centre of mass, and
        a pair of forces, as PyBullet turns torques on a base into axes of its own.
        """
        bullet, (force, moment) = self._bullet, np.split(self._carried, 2)
        poses = [bullet.getBasePositionAndOrientation(self._robot)[0]]
        if links := list(range(bullet.getNumJoints(self._robot))):
            poses += [state[0] for state in bullet.getLinkStates(self._robot, links)]
        com = np.average(np.array(poses), axis=0, weights=self._masses)
        arm = np.eye(3)[int(np.abs(moment).argmin())]
        arm = arm - moment * (arm @ moment) / max(
            float(moment @ moment), 1e-300
        )  # across the moment
        pair = cross(moment, arm) / (2.0 * float(arm @ arm))
        for each, at in ((force, com), (pair, com + arm), (-pair, com - arm)):
            bullet.applyExternalForce(
                self._robot,
                -1,
                each.tolist(),
                at.tolist(),
                bullet.WORLD_FRAME,
            )

    def close(self) -> None:
        """Disconnect from the physics server."""
        if self._bullet is not None:
            self._bullet.disconnect()
            self._bullet = None

    def _begin(self) -> None:
        """An empty world.

        The order of contacts is fixed, or two runs differ.
        """
        bullet = self._bullet
        bullet.resetSimulation()
        bullet.setGravity(0.0, 0.0, -self.gravity_m_s2)
        bullet.setPhysicsEngineParameter(
            fixedTimeStep=PHYSICS_S,
            numSolverIterations=150,
            deterministicOverlappingPairs=1,
            enableConeFriction=1,
        )

    def _lay(self, terrain: Terrain) -> None:
        """Every patch as a static convex body, or heights as a field, with their friction."""
        bullet = self._bullet
        if isinstance(terrain, Ground):
            x, y, heights = terrain.even(SPACING_M)
            shape = bullet.createCollisionShape(
                bullet.GEOM_HEIGHTFIELD,
                meshScale=[x[1] - x[0], y[1] - y[0], 1.0],
                heightfieldData=heights.T.ravel().tolist(),
                numHeightfieldRows=len(x),
                numHeightfieldColumns=len(y),
            )
            middle = np.array(  # where PyBullet has its origin
                [x.mean(), y.mean(), 0.5 * (heights.min() + heights.max())]
            )
            self._still(shape, middle - self._origin_m, terrain.friction)
            return
        for patch in terrain:
            solid = patch.solid
            middle = solid.corners.mean(axis=0)
            shape = bullet.createCollisionShape(
                bullet.GEOM_MESH,
                vertices=(solid.corners - middle).tolist(),
                indices=solid.triangles.ravel().tolist(),
            )
            self._still(shape, middle - self._origin_m, patch.friction)

    def _still(self, shape: int, middle: Array, friction: float) -> None:
        """A body that does not move."""
        bullet = self._bullet
        body = bullet.createMultiBody(0.0, shape, basePosition=middle.tolist())
        bullet.changeDynamics(
            body,
            -1,
            lateralFriction=friction,
            rollingFriction=0.0,
            spinningFriction=0.0,
            restitution=0.0,
        )

    def _soften(self, counts: Array) -> None:
        """Have each foot's points in contact share ``SoftContact``, by PyBullet's own spring with a
        damper, which is stepped implicitly.

        Arguments:
            counts: how many as deep as the deepest they amount to, shape (N,).
        """
        if self.contact is None:
            return
        damping = self.contact.damped(self.robot.mass_kg, len(self.robot.limbs))
        for foot in np.flatnonzero(counts != self._counts):
            share = 1.0 / float(counts[foot])
            self._bullet.changeDynamics(
                self._robot,
                self._feet[foot],
                contactStiffness=share * self.contact.stiffness_n_m,
                contactDamping=share * damping,
            )
        self._counts = counts

    def _loaded(self) -> int:
        """The robot, its links not merged, its joints free of PyBullet's own motors and damping."""
        import tempfile
        from pathlib import Path

        bullet = self._bullet
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "robot.urdf"
            path.write_text(self.body.urdf, encoding="utf-8")
            for name, content in self.body.hulls.items():
                (Path(folder) / name).write_bytes(content)
            flags = (
                bullet.URDF_USE_INERTIA_FROM_FILE | bullet.URDF_USE_SELF_COLLISION_EXCLUDE_PARENT
            )
            robot = bullet.loadURDF(str(path), flags=flags | bullet.URDF_USE_SELF_COLLISION)
        names, self._links = {}, {self.body.base: -1}
        for index in range(bullet.getNumJoints(robot)):
            info = bullet.getJointInfo(robot, index)
            names[info[1].decode()] = self._links[info[12].decode()] = index
        self._motors = [names[joint] for joint in self.joints]
        self._feet = [self._links[foot] for foot in self.body.feet]
        heart = bullet.getDynamicsInfo(robot, -1)  # PyBullet's base is at its centre of mass
        self._heart_m, self._heart = np.array(heart[3]), _matrix(heart[4])
        links = range(-1, bullet.getNumJoints(robot))
        self._masses = [bullet.getDynamicsInfo(robot, link)[0] for link in links]
        bullet.setJointMotorControlArray(
            robot,
            self._motors,
            bullet.VELOCITY_CONTROL,
            forces=[0.0] * len(self._motors),
        )
        for link in range(-1, bullet.getNumJoints(robot)):
            bullet.changeDynamics(
                robot,
                link,
                lateralFriction=1.0,
                rollingFriction=0.0,
                spinningFriction=0.0,
                restitution=0.0,
                linearDamping=0.0,
                angularDamping=0.0,
                jointDamping=0.0,
            )
        return int(robot)

    def _part_at_rest(self) -> None:
        """Links never collide where the model says so, and where they overlap as the robot stands:
        drawn so.
        """
        bullet = self._bullet
        self._place_joints(np.concatenate([leg.stance_rad for leg in self.model.legs]))
        pairs = [(self._links[first], self._links[second]) for first, second in self.body.apart]
        bullet.performCollisionDetection()
        pairs += [
            (contact[3], contact[4])
            for contact in bullet.getContactPoints(self._robot, self._robot)
        ]
        for first, second in pairs:
            bullet.setCollisionFilterPair(self._robot, self._robot, first, second, 0)

    def _place_joints(self, angles_rad: Array) -> None:
        for joint, angle in zip(self._motors, angles_rad, strict=True):
            self._bullet.resetJointState(self._robot, joint, float(angle))

    def _joint_state(self) -> tuple[Array, Array]:
        states = self._bullet.getJointStates(self._robot, self._motors)
        return np.array([state[0] for state in states]), np.array([state[1] for state in states])

    def _contacts(self, forces: Array) -> float:
        """Add the forces of the terrain on feet to them; the force on anything else, and of links
        on each other, is returned [N].
        """
        bump = 0.0
        touched: dict[int, list[tuple[float, Array]]] = {}
        for contact in self._bullet.getContactPoints(bodyA=self._robot):
            normal, first, second = (np.array(contact[k]) for k in (7, 11, 13))
            force = contact[9] * normal + contact[10] * first + contact[12] * second
            if contact[2] != self._robot and contact[3] in self._feet:
                foot = self._feet.index(contact[3])
                forces[foot] += force
                touched.setdefault(foot, []).append((-contact[8], normal))
            else:
                bump += float(np.linalg.norm(force))
        if self.contact is not None:
            touches = {foot: zip(*contacts, strict=True) for foot, contacts in touched.items()}
            counts = {foot: points(*map(np.array, pair)) for foot, pair in touches.items()}
            self._soften(np.array([counts.get(foot, 1.0) for foot in range(len(self._feet))]))
        return bump

    def _state(self, forces: Array, bump: float, torques: Array) -> State:
        bullet = self._bullet
        middle, quaternion = bullet.getBasePositionAndOrientation(self._robot)
        rotation = _matrix(quaternion) @ self._heart.T
        arm = rotation @ self._heart_m
        linear, angular = np.array(bullet.getBaseVelocity(self._robot))
        angles, rates = self._joint_state()
        links = bullet.getLinkStates(self._robot, self._feet, computeForwardKinematics=1)
        turns = np.array([_matrix(link[5]) for link in links])
        return State(
            time_s=self._time,
            position_m=np.array(middle) - arm,
            rotation=rotation,
            velocity=np.concatenate([linear - np.cross(angular, arm), angular]),
            angles_rad=angles,
            rates_rad_s=rates,
            torques_nm=torques,
            feet_m=np.array([link[4] for link in links])
            + (turns @ self.body.tips_m[:, :, None])[..., 0],
            forces_n=forces,
            bump_n=bump,
            sent_rad=self._sent.copy(),
        )


def _matrix(quaternion: Sequence[float]) -> Array:
    """The rotation matrix of (x, y, z, w), shape (3, 3)."""
    return np.asarray(Rotation.from_quat(quaternion).as_matrix())
