"""State of the robot as the closed loop estimates it from measurements: where the robot stands, how
far off that is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.kinematics import Kinematics, rotation_of
from stancekit.planners.search.pieces import Standing
from stancekit.planners.terrain import Patch

from ..log import TOUCH_N, Record
from ..worlds.world import State
from .surfaces import coplanar
from .tracker import Target

LEAST = 3
"""So many feet tell how the body is turned."""
_SMOOTH_S = 0.03
"""Time constant of the body's velocity."""


class LegOdometry:
    """Odometry of one motion.

    Arguments:
        first: what is sent first; the first body is where it should be.
        felt: feet feel forces.
    """

    def __init__(
        self, kinematics: Kinematics, first: Target, rate_hz: float, *, felt: bool = False
    ) -> None:
        self._kinematics, self._rate_hz, self._felt = kinematics, rate_hz, felt
        self.origin_m, self.rotation = first.origin_m, rotation_of(first.sample.rotation_rad)
        limbs = len(first.sample.foothold)
        self._before, self._places = np.full(limbs, -1), np.zeros((limbs, 3))
        self._velocity: Array | None = None

    def seen(self, target: Target, state: State) -> State:
        """A state with the body's pose, velocity and feet by odometry.

        Arguments:
            target: what this state came of.
        """
        feet, stood = self._kinematics.feet(state.angles_rad), target.sample.foothold
        if self._felt:
            stood = np.where(np.linalg.norm(state.forces_n, axis=1) > TOUCH_N, stood, -1)
        held, (origin, rotation) = (
            (stood >= 0) & (stood == self._before),
            (self.origin_m, self.rotation),
        )
        if held.any():
            self.origin_m, self.rotation = _body(
                feet[held], (self._places + target.rolled_m)[held], rotation
            )
        now = self.origin_m + feet @ self.rotation.T
        self._places = np.where(held[:, None], self._places, now - target.rolled_m)
        self._before = stood
        turned = Rotation.from_matrix(self.rotation @ rotation.T).as_rotvec()
        moved = self._rate_hz * np.concatenate([self.origin_m - origin, turned])
        share = 1.0 - np.exp(-1.0 / (_SMOOTH_S * self._rate_hz))
        before = moved if self._velocity is None else self._velocity
        self._velocity = before + share * (moved - before)
        return replace(
            state,
            position_m=self.origin_m,
            rotation=self.rotation,
            velocity=self._velocity,
            feet_m=now,
        )


def leg_odometry(record: Record, kinematics: Kinematics) -> tuple[Array, Array]:
    """p_WB and R_WB of the base's frame at every control period, shape (T, 3) [m] and (T, 3, 3).

    The first body is where it should be. Which feet stand is the plan's to say.
    """
    odometry = LegOdometry(kinematics, record.pairs[0][0], 1.0)
    states = [odometry.seen(target, state) for target, state in record.pairs]
    return np.array([state.position_m for state in states]), np.array(
        [state.rotation for state in states]
    )


def odometry_error_m(record: Record, kinematics: Kinematics) -> float:
    """Largest distance of the body from where it should be, by leg odometry [m]."""
    origins, _ = leg_odometry(record, kinematics)
    return float(
        np.linalg.norm(origins - [target.origin_m for target, _ in record.pairs], axis=1).max()
    )


def _body(feet: Array, places: Array, rotation: Array) -> tuple[Array, Array]:
    """The body whose feet, in its frame, come nearest to their places.

    Arguments:
        rotation: the one before.
    """
    middle, goal = feet.mean(axis=0), places.mean(axis=0)
    if len(feet) >= LEAST:
        rotation = Rotation.align_vectors(places - goal, feet - middle)[0].as_matrix()
    return goal - rotation @ middle, rotation


_ROUNDING_M = 1e-9
BORDER_M = 0.02
"""So far beyond its patch's border a foot may have slid and still be taken for standing on the
border."""


def measured_com_m(kinematics: Kinematics, state: State) -> Array:
    """The measured centre of mass, shape (3,) [m]."""
    return np.asarray(state.position_m + state.rotation @ kinematics.com_offset(state.angles_rad))


def deviation_m(
    target: Target, state: State, kinematics: Kinematics, seeks: NDArray[np.bool_]
) -> float:
    """Distance of the body, or of a foot that stands, from the plan [m].

    Arguments:
        seeks: feet that do not yet, shape (N,).
    """
    sample = target.sample
    body = float(np.linalg.norm(measured_com_m(kinematics, state) - sample.com_m))
    stands = sample.stands & ~seeks
    feet = np.linalg.norm(state.feet_m - target.rolled_m - sample.feet_m, axis=1)[stands]
    return max(body, float(feet.max(initial=0.0)))


def estimate_standing(
    patches: tuple[Patch, ...], state: State, kinematics: Kinematics, terrain: Sequence[Patch] = ()
) -> Standing | None:
    """Estimate how the robot stands; None where a foot left its patch.

    Arguments:
        patches: under all feet. Feet are put back into the planes of theirs. One that slid beyond
            its patch stands on what terrain there is in the same plane, or, where it is only a
            little beyond all that, on the border: what a plan takes feet to be off by, joints would
            make them slide.
    """
    toes, under = list[Array](), list[Patch]()
    for foot, radius, patch in zip(state.feet_m, kinematics.radii_m, patches, strict=True):
        toe = foot - radius * patch.normal
        inside = nearest_on(patch, toe)
        if _along(patch, inside - toe) > 0.0:
            around = [
                (other, nearest_on(other, toe)) for other in terrain if coplanar(patch, other)
            ]
            patch, inside = min(
                [(patch, inside), *around], key=lambda pair: _along(pair[0], pair[1] - toe)
            )
        if np.linalg.norm(inside - toe) > BORDER_M:
            return None
        toes.append(inside)
        under.append(patch)
    return Standing(
        com_m=measured_com_m(kinematics, state),
        rotation_rad=Rotation.from_matrix(state.rotation).as_rotvec(),
        toes_m=np.array(toes),
        patches=tuple(under),
        angles_rad=np.array(state.angles_rad),
    )


def _along(patch: Patch, away_m: Array) -> float:
    """Part of a way that is along a patch [m]; 0 for rounding errors."""
    along = float(np.linalg.norm(away_m - (away_m @ patch.normal) * patch.normal))
    return along if along > _ROUNDING_M else 0.0


def nearest_on(patch: Patch, point: Array) -> Array:
    """The point of a patch's surface nearest to a point, shape (3,) [m]."""
    corners, normal = patch.vertices_m, patch.normal
    flat = point - ((point - patch.centre_m) @ normal) * normal
    nearest = list[Array]()
    inside = True
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge = b - a
        inwards = np.cross(normal, edge)
        inwards = inwards * np.sign(inwards @ (patch.centre_m - a))
        inside &= bool((flat - a) @ inwards >= 0.0)
        s = np.clip((flat - a) @ edge / max(float(edge @ edge), 1e-18), 0.0, 1.0)
        nearest.append(a + s * edge)
    return flat if inside else min(nearest, key=lambda p: float(np.linalg.norm(p - flat)))
