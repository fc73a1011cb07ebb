"""Candidates of a leap as numbers: what the hand rule, learned scores and environments see of each
of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..files.arrays import Array, cross
from .numbers import LeapNumbers
from .scp import FRICTION_SHARE

OF_CANDIDATE = (
    "grip",
    "room_m",
    "friction",
    "normal_x",
    "normal_y",
    "normal_z",
    "middle_x_m",
    "middle_y_m",
    "middle_z_m",
    "size_m",
    "push_x",
    "push_y",
    "push_z",
    "moment_x_m",
    "moment_y_m",
    "moment_z_m",
    "fixed",
    "begins",
    "ends",
    "shoulder_x_m",
    "shoulder_y_m",
    "shoulder_z_m",
)
"""Features of one candidate. grip: friction left over at the nominal force, in units of it; room:
least of what is left of reach and height; middle: of the patch, from the mean centre of mass while
the limb stands; size: mean distance of the corners from it; push: nominal force in units of the
weight; moment: of that force about the mean centre of mass; fixed: 1 where the foothold has no
other candidate; begins, ends: share of the leap at which the limb starts and stops to stand there;
shoulder: of the limb in the body frame."""
OF_LEAP = (
    "goal_x_m",
    "goal_y_m",
    "goal_z_m",
    "velocity_x_m_s",
    "velocity_y_m_s",
    "velocity_z_m_s",
    "goal_radius_m",
    "duration_s",
    "flight_s",
    "tilt_rad",
)
"""Features of a leap and one timing. goal: from the start; velocity: at the goal; flight: time
without any foothold."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LeapFeatures:
    """Features of a leap with one timing before any choice is tried.

    Arguments:
        candidates: shape (P, R, F), by foothold and candidate, the F of ``OF_CANDIDATE``, 0 where
            there is no candidate.
        mask: where there is one, shape (P, R).
        leap: shape (G,), the G of ``OF_LEAP``.
    """

    candidates: Array
    mask: Array
    leap: Array

    @classmethod
    def of(cls, numbers: LeapNumbers) -> LeapFeatures:
        """The features of a leap's numbers."""
        scaled, layout = numbers.scaled, numbers.layout
        foothold = layout.candidate_footholds
        frame, limb, standing = layout.standing
        stands = [np.flatnonzero(standing == j) for j in range(layout.footholds)]
        limbs = np.array([limb[limbs_of_stance[0]] for limbs_of_stance in stands])
        com = np.array(
            [numbers.nominal.com[frame[limbs_of_stance]].mean(axis=0) for limbs_of_stance in stands]
        )
        spans = (
            np.array([numbers.times[frame[limbs_of_stance][[0, -1]]] for limbs_of_stance in stands])
            / numbers.times[-1]
        )
        middles = np.array([piece.mean(axis=0) for piece in scaled.pieces])
        sizes = np.array(
            [
                float(np.linalg.norm(piece - middle, axis=1).mean())
                for piece, middle in zip(scaled.pieces, middles, strict=True)
            ]
        )
        grip, pushes = _grip(numbers)
        away = middles - com[foothold]
        options = np.bincount(foothold, minlength=layout.footholds)
        columns = [
            grip,
            _room(numbers, middles),
            scaled.friction,
            *scaled.frames[:, :, 0].T,
            *away.T,
            sizes,
            *pushes[foothold].T,
            *cross(away, pushes[foothold]).T,
            (options == 1.0)[foothold],
            *spans[foothold].T,
            *scaled.shoulders[limbs[foothold]].T,
        ]
        tables = [
            scaled.by_candidate(np.asarray(column, dtype=np.float64), 0.0) for column in columns
        ]
        leap = numbers.leap
        goal = leap.goal.com_m - leap.start.com_m
        flight = numbers.lasts.sum() - numbers.lasts[np.unique(numbers.stance_intervals)].sum()
        return cls(
            candidates=np.stack(tables, axis=-1),
            mask=scaled.by_candidate(np.ones(len(foothold)), 0.0),
            leap=np.array(
                [
                    *goal,
                    *leap.goal.velocity_m_s,
                    leap.goal_radius_m,
                    numbers.times[-1],
                    flight,
                    leap.limits.tilt_rad,
                ]
            ),
        )

    def padded(self, options: int) -> LeapFeatures:
        """Features with room for more candidates per foothold, which are masked."""
        more = [(0, 0), (0, options - self.mask.shape[1])]
        return LeapFeatures(
            candidates=np.pad(self.candidates, [*more, (0, 0)]),
            mask=np.pad(self.mask, more),
            leap=self.leap,
        )


def _grip(numbers: LeapNumbers) -> tuple[Array, Array]:
    """Friction left over at the nominal force of every candidate, in units of that force, shape
    (K,); and the mean nominal force of every foothold in units of the weight, shape (P, 3).
    """
    scaled, layout, nominal = numbers.scaled, numbers.layout, numbers.nominal
    contacts = layout.contacts[2]
    pushes = np.zeros((layout.footholds, 3))
    np.add.at(pushes, contacts, nominal.forces)
    along = (pushes / np.linalg.norm(pushes, axis=1, keepdims=True))[layout.candidate_footholds]
    pulls = np.matmul(along[:, None], scaled.frames)[:, 0]
    grip = FRICTION_SHARE * scaled.friction * pulls[:, 0] - np.hypot(pulls[:, 1], pulls[:, 2])
    return grip, pushes / np.bincount(contacts, minlength=layout.footholds)[:, None]


def _room(numbers: LeapNumbers, middles: Array) -> Array:
    """The least of what is left of reach and height where the limb stands, at a patch's middle,
    shape (K,) [m].
    """
    scaled, layout = numbers.scaled, numbers.layout
    frame, limb, foothold = layout.standing
    com = numbers.nominal.com[frame]
    room = np.full(len(middles), np.inf)
    height = numbers.leap.limits.height_m
    for j in range(layout.footholds):
        mine = np.flatnonzero(foothold == j)
        places = np.flatnonzero(layout.candidate_footholds == j)
        away = middles[places][:, None] - com[mine]
        left = scaled.reach[limb[mine]] - np.linalg.norm(
            away - scaled.shoulders[limb[mine]], axis=2
        )
        left = np.minimum(left, -height - away[:, :, 2])
        if layout.reach_rows:
            half = np.flatnonzero(layout.row_limbs == limb[mine[0]])
            inside = scaled.half_spaces.bounds[half] - away @ scaled.half_spaces.normals[half].T
            left = np.minimum(left, inside.min(axis=2))
        room[places] = left.min(axis=1)
    return room
