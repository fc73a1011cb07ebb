"""Overlaps of a walk's links with each other and the ground, and their derivatives, for
``constraints.bodies``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...answer.report import Report
from ...answer.trajectory import Trajectory
from ...files.arrays import Array
from ...robot.bodies import Bodies
from ...robot.inverse_kinematics import descend
from ...robot.kinematics import rotation_of
from ...robot.overlaps import Overlap, WholeBody
from ...terrain.obstacles import Obstacles
from ...verify.trajectory_measurements import TrajectoryMeasurements
from ...verify.trajectory_whole_body import WholeBodyMeasurements
from ..constraints.bodies import Overlaps
from ..variables.structure import Structure

STEP = 2e-3
"""Between postures whose depths are compared [m, rad]."""
CLEAR_M, TRIES = 2e-3, 21
"""Links are apart when they are so far off each other; steps of the way of feet to where they
stand."""


def leg_overlaps(structure: Structure, report: Report[Trajectory]) -> Overlaps:
    """Rows at the nodes on both sides of every posture of a report's trajectory in which something
    overlaps.
    """
    walk = report.answer
    body = WholeBodyMeasurements(TrajectoryMeasurements(walk))
    bodies = Bodies(body.kinematics, Obstacles.under(walk.terrain))
    slopes = _Slopes(body, bodies)
    deepest = dict[tuple[int, str, str], Overlap]()
    times_s, postures = body.spaced()
    for _, block in bodies.sweep(postures, terrain_m=0.0, links_m=0.0, between=False):
        for moment, each in block:
            at = times_s[int(moment)] / structure.settings.step_s
            for node in {int(np.floor(at)), int(np.ceil(at))}:
                key = node, each.link, each.other
                if key not in deepest or deepest[key].depth_m < each.depth_m:
                    deepest[key] = each
    rows = list[tuple[Array, ...]]()
    for (node, *_), overlap in deepest.items():
        sample = int(np.clip(np.rint(structure.times_s[node] / walk.step_s), 0, walk.samples - 1))
        rows.append((np.array(node), *slopes.row(sample, overlap)))
    names = ("node", "feet", "depth_m", "feet_m", "by_foot", "torso_m", "rotation", "by_torso")
    return Overlaps(
        **dict(zip(names, (np.array(part) for part in zip(*rows, strict=True)), strict=True))
    )


class _Slopes:
    """Derivatives of an overlap's depth in the feet in the torso's frame, and in the torso."""

    def __init__(self, body: WholeBodyMeasurements, bodies: Bodies) -> None:
        self._body, self._bodies, self._walk = body, bodies, body.trajectory
        self._solver = body.kinematics
        self._legs = {link: mount.leg for link, mount in self._solver.model.mounts.items()}

    def row(self, sample: int, overlap: Overlap) -> tuple[Array, ...]:
        """Feet, depth, r₀, derivatives in both feet, p₀, R₀, derivatives in the torso."""
        pair = [self._legs.get(name) for name in (overlap.link, overlap.other)]
        legs = sorted({leg for leg in pair if leg is not None}) or [0]
        feet = np.array([legs[0], legs[-1]])
        torso, rotation = self._walk.torso_m[sample], self._walk.rotation[sample]
        at = (self._walk.feet_m[sample, feet] - torso) @ rotation
        posture = self._body.posture(sample)
        if overlap.other in self._legs:
            depth, by_foot, by_torso = *self._homeward(overlap, posture, legs, at), np.zeros(6)
        else:
            depth, (by_foot, by_torso) = overlap.depth_m, self._tangent(overlap, posture, legs)
        return feet, np.array(depth), at, by_foot, torso, rotation, by_torso

    def _homeward(
        self, overlap: Overlap, posture: WholeBody, legs: list[int], at: Array
    ) -> tuple[float, Array]:
        """Distance that feet have to go towards where they stand for the links to come apart, as a
        depth [m], and the direction. Links may be thinner than they are deep in each other, so that
        a tangent leads nowhere.
        """
        home = np.array([self._walk.robot.feet[leg].nominal_m for leg in legs]) - at[: len(legs)]
        for share in np.linspace(0.0, 1.0, TRIES):
            moved = posture
            for leg, way in zip(legs, home, strict=True):
                moved = self._reaching(moved, leg, share * way)
            if self._bodies.depth(overlap, moved) < -CLEAR_M:
                break
        far = float(np.linalg.norm(home))
        by_foot = np.zeros((2, 3))
        by_foot[: len(legs)] = -home / max(far, 1e-9)
        return share * far, by_foot

    def _tangent(
        self, overlap: Overlap, posture: WholeBody, legs: list[int]
    ) -> tuple[Array, Array]:
        """The depth's derivatives in the foot and in the torso, by differences."""
        axes = STEP * np.concatenate([np.eye(3), -np.eye(3)])
        ways: tuple[Callable[[Array], WholeBody], ...] = (
            lambda step: self._reaching(posture, legs[0], step),
            lambda step: replace(posture, origin_m=posture.origin_m + step),
            lambda step: self._turning(posture, step),
        )
        depths = np.array(
            [[self._bodies.depth(overlap, way(step)) for step in axes] for way in ways]
        )
        slopes = (depths[:, :3] - depths[:, 3:]) / (2.0 * STEP)
        return np.stack([slopes[0], np.zeros(3)]), slopes[1:].ravel()

    def _reaching(self, posture: WholeBody, leg: int, by_m: Array) -> WholeBody:
        """With one foot elsewhere in the body."""
        joints, model = self._solver.joints_of(leg), self._solver.model.legs[leg]
        angles = np.array(posture.angles)
        centre = model.chain.feet(angles[None, joints]) + by_m
        angles[joints] = descend(model, centre, angles[None, joints])[0][0]
        return replace(posture, angles=angles)

    def _turning(self, posture: WholeBody, by_rad: Array) -> WholeBody:
        """With the torso turned about its own axes through the centre of mass."""
        shift = self._solver.com_offset(posture.angles)
        rotation = posture.rotation @ rotation_of(by_rad)
        return replace(
            posture,
            rotation=rotation,
            origin_m=posture.origin_m + (posture.rotation - rotation) @ shift,
        )
