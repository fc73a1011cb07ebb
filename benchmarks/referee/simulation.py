"""A file played: the simulation step by step, until its end or a fall."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from .body import Body, build
from .feedback import shared, wrench
from .files import BrokenFile, KeyFrames, Leap, Played, Samples, read
from .ground import Surface, lay_heights, lay_patches
from .joints import Commands, Solver, commands
from .reference import Reference, cross, of_leap, of_plan, of_walk, rotation_between
from .settings import Bounds, Push, Settings, Wrong

Array = NDArray[np.float64]
STILL_S = 0.2
"""What the ground carries is the mean over the last part of it [s]."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """What happened.

    Attributes:
        stood: whether it did not fall, and ended near where the file ends.
        fell_s: when it fell, None where it did not [s].
        of_s: how long the file is [s].
        rms_mm: root mean square distance of the centre of mass from the file's [mm].
        most_mm: the largest of these [mm].
        end_mm: the last of these [mm].
        turned_rad: largest angle between the body and the file's [rad].
        slide_mm: farthest that a foot slid in a stance, rolling left out [mm].
        bumped_s: how long anything but a foot touched the ground [s].
        torque_share: largest torque of a joint in units of its limit, before it is cut there.
        missed_mm: how far feet are from the file's at most by inverse kinematics [mm].
        carried: what the ground carries at the end, in units of the robot's weight.
        held_n: of a push: the largest that was held [N]; as large as was asked for where it never
            fell.
    """

    stood: bool
    fell_s: float | None
    of_s: float
    rms_mm: float
    most_mm: float
    end_mm: float
    turned_rad: float
    slide_mm: float
    bumped_s: float
    torque_share: float
    missed_mm: float
    carried: float
    held_n: float | None = None

    def json(self) -> dict[str, Any]:
        """Values for a line."""
        return {
            name: value
            for name, value in asdict(self).items()
            if value is not None or name == "fell_s"
        }


def play(
    path: str | Path, settings: Settings, wrong: Wrong = Wrong(), push: Push | None = None
) -> Row:
    """Play a file.

    Arguments:
        path: a plan, a walk or a leap.
        settings: the referee's.
        wrong: what is not as the file has it.
        push: instead of the motion, one of its stances is pushed until it falls.

    Raises:
        BrokenFile: in one line, for what cannot be played.
    """
    if push is not None:
        return next(pushed(path, settings, wrong, (push,)))
    played = read(path)
    with _in_one_line(path):
        return _Run(*prepared(played, settings, wrong), settings, wrong).to_the_end()


def pushed(
    path: str | Path, settings: Settings, wrong: Wrong, pushes: Iterable[Push]
) -> Iterator[Row]:
    """Push stances of a file one after another, each until it falls.

    Arguments:
        path: a plan or a walk.
        settings: the referee's.
        wrong: what is not as the file has it.
        pushes: the motion is prepared once for all of them, and each is asked for when the one
            before it ended.

    Raises:
        BrokenFile: in one line, for what cannot be played.
    """
    played = read(path)
    with _in_one_line(path):
        ready = prepared(played, settings, wrong)
        for push in pushes:
            yield _pushed(ready, played, settings, wrong, push)


@contextmanager
def _in_one_line(path: str | Path) -> Iterator[None]:
    """Raise BrokenFile for what comes of a file's numbers."""
    try:
        yield
    except (ValueError, mujoco.FatalError) as error:
        raise BrokenFile(f"{path}: {' '.join(str(error).split())[:300]}") from None


def prepared(played: Played, settings: Settings, wrong: Wrong) -> tuple[Body, Reference, Commands]:
    """The body that is simulated, and what it is commanded by whoever believes the file."""
    motion, contact = played.motion, wrong.contact(settings)
    lay: Callable[[Any], None]
    if not isinstance(motion, Samples):
        patches = motion.patches

        def lay(spec: Any) -> None:
            lay_patches(spec, patches, settings.thick_m, wrong.friction, contact)
    else:
        walk, surface = motion, Surface(motion.x_m, motion.y_m, motion.heights_m)

        def lay(spec: Any) -> None:
            lay_heights(spec, surface, walk, wrong.friction, contact)

    gravity = played.gravity_m_s2
    believed = build(played.robot, lambda _: None, settings, contact, gravity)
    if isinstance(motion, KeyFrames):
        reference = of_plan(motion, believed.radii_m, settings)
    elif isinstance(motion, Leap):
        reference = of_leap(motion, believed.radii_m, settings)
    else:
        reference = of_walk(motion, surface, believed.radii_m, settings)
    simulated = build(played.robot, lay, settings, contact, gravity, wrong.mass)
    return simulated, reference, commands(believed, reference)


def _pushed(
    ready: tuple[Body, Reference, Commands],
    played: Played,
    settings: Settings,
    wrong: Wrong,
    push: Push,
) -> Row:
    """One stance, held still, pushed."""
    if isinstance(played.motion, Leap):
        raise ValueError("push: expected a plan or a walk, got a leap")
    reference = ready[1]
    if isinstance(played.motion, Samples):
        moment = round((push.stance + settings.timing.rest_s) / reference.step_s)
    elif int(push.stance) in reference.stances:
        moment = reference.stances[int(push.stance)]
    else:
        known = f"0 to {len(played.motion.stances) - 1}"
        raise ValueError(f"push: stance: expected {known}, got {push.stance}")
    run = _Run(*ready, settings, wrong)
    return run.pushed(min(max(moment, 0), len(reference.com_m) - 1), push)


class _Run:
    """One simulation."""

    def __init__(
        self, body: Body, reference: Reference, told: Commands, settings: Settings, wrong: Wrong
    ) -> None:
        self.body, self.reference, self.told = body, reference, told
        self.settings, self.wrong = settings, wrong
        self.data, self.solver = mujoco.MjData(body.model), Solver(body)
        self.substeps = max(1, round(reference.step_s / settings.physics_s))
        self.late = round(1e-3 * wrong.delay_ms / settings.physics_s)
        draws = np.random.default_rng(wrong.seed).uniform(-1.0, 1.0, len(body.places))
        self.offset = np.radians(wrong.offset_deg) * draws
        self.torques, self.moments, self.bends = list[Array](), list[int](), list[Array]()
        self.shifts = np.zeros((len(body.legs), 3))
        self.errors, self.turned, self.slid = list[float](), 0.0, 0.0
        self.bumped, self.share = 0, 0.0
        self.touched: list[int | None] = [None] * len(body.feet)
        self.slips, self.before = (
            [np.zeros(3)] * len(body.feet),
            [(np.zeros(3), np.zeros(4))] * len(body.feet),
        )
        self.normal_n = list[float]()
        self.count = 0

    def to_the_end(self) -> Row:
        """Play all moments."""
        self._begin(0)
        fell = None
        for moment in range(len(self.reference.com_m)):
            self._advance(moment)
            if self._off(moment, self.settings.falls):
                fell = (moment + 1) * self.reference.step_s
                break
        near = not self._off(len(self.reference.com_m) - 1, self.settings.ends)
        return self._row(fell, stood=fell is None and near)

    def pushed(self, moment: int, push: Push) -> Row:
        """Hold a moment, and push until it falls."""
        self._begin(moment)
        weight = self.body.mass_kg * float(np.linalg.norm(self.body.model.opt.gravity))
        rate, angle = self.settings.push.rate_n_s * weight, np.radians(push.towards_deg)
        way = np.array([np.cos(angle), np.sin(angle), 0.0])
        seconds = self.settings.push.rest_s + push.most_n / rate
        held, fell = push.most_n, None
        for count in range(round(seconds / self.reference.step_s)):
            now = count * self.reference.step_s
            size = min(max(rate * (now - self.settings.push.rest_s), 0.0), push.most_n)
            self.data.xfrc_applied[self.body.base, :3] = size * way
            self._advance(moment, still=True)
            if self._off(moment, self.settings.falls):
                held, fell = size, now
                break
        return self._row(fell, stood=fell is None, held_n=held, of_s=seconds)

    def _begin(self, moment: int) -> None:
        self.data.qpos[:] = self.told.positions[moment]
        mujoco.mj_forward(self.body.model, self.data)

    def _advance(self, moment: int, still: bool = False) -> None:
        """One command, and the simulation until the next."""
        body, data, told = self.body, self.data, self.told
        mujoco.mj_subtreeVel(body.model, data)
        self.torques.append(told.torques[moment] + self._feedback(moment, still))
        self.bends.append(self._bends(moment))
        self.moments.append(moment)
        carried = 0.0
        for _ in range(self.substeps):
            heard = max(self.count - self.late, 0) // self.substeps
            at = self.moments[heard]
            rates = 0.0 if still else told.velocities[at, body.rates]
            wanted = told.positions[at, body.places] + self.bends[heard]
            position = wanted - data.qpos[body.places] - self.offset
            effort = self.wrong.stiffness * body.stiffness * position
            effort += body.damping * (rates - data.qvel[body.rates]) + self.torques[heard]
            data.qfrc_applied[:] = 0.0
            data.qfrc_applied[body.rates] = np.clip(effort, -body.most, body.most)
            self.share = max(self.share, float(np.max(np.abs(effort) / body.most)))
            for place, rate in body.others:
                bent = told.positions[at, place] - data.qpos[place]
                stiff = self.settings.joints.other_n
                damped = self.settings.joints.damping_s * stiff * data.qvel[rate]
                data.qfrc_applied[rate] = data.qfrc_bias[rate] + stiff * bent - damped
            mujoco.mj_step(body.model, data)
            self.count += 1
            carried += self._touched()
        self.normal_n.append(carried / self.substeps)
        self._measure(moment)

    def _feedback(self, moment: int, still: bool) -> Array:
        body, data, to = self.body, self.data, self.reference
        feet = np.flatnonzero(to.stands[moment])
        if not self.wrong.feedback or not len(feet):
            return np.zeros(len(body.places))
        turn = data.qpos[3:7]
        rate = data.xmat[body.base].reshape(3, 3) @ data.qvel[3:6]
        speed, turning = (np.zeros(3), np.zeros(3)) if still else self._speeds(moment)
        com = data.subtree_com[body.base]
        wanted = wrench(
            self.settings.feedback,
            body.mass_kg,
            to.com_m[moment] - com,
            speed - data.subtree_linvel[body.base],
            rotation_between(to.turn[moment], turn),
            turning - rate,
        )
        normals = to.normals[moment, feet]
        points = data.geom_xpos[[body.balls[foot] for foot in feet]]
        points = points - body.radii_m[feet, None] * normals
        planned = to.forces_n[moment, feet]
        found = shared(
            self.settings.feedback,
            wanted,
            points - com,
            planned,
            normals,
            to.friction[moment, feet],
        )
        torque = np.zeros(len(body.places))
        for foot, point, change in zip(feet, points, found - planned, strict=True):
            torque -= self.solver.slope(data, int(foot), point)[:, body.rates].T @ change
        return torque

    def _bends(self, moment: int) -> Array:
        """By how much joints bend so that feet in the air go where they should although the body is
        off.

        Feet that stand come back from that slowly, and draw the body with them. In a plan feet go
        where the file has them in the world. A walk, which may balance on two feet, steps where its
        body is, at the file's height.
        """
        body, data, to = self.body, self.data, self.reference
        bends = np.zeros(len(body.places))
        if not self.wrong.feedback:
            return bends
        gains, step = self.settings.feedback, to.step_s
        turn = rotation_between(to.turn[moment], data.qpos[3:7])
        com = data.subtree_com[body.base]
        for leg, its in enumerate(body.legs):
            if to.stands[moment, leg]:
                self.shifts[leg] *= 1.0 - step / gains.fade_s
            else:
                arm = to.centres_m[moment, leg] - com
                off = to.com_m[moment] - com + cross(turn, arm)
                if to.dynamic:
                    off[:2] = 0.0
                self.shifts[leg] += min(step / gains.swing_s, 1.0) * (off - self.shifts[leg])
            if self.shifts[leg].any():
                ball = data.geom_xpos[body.balls[leg]]
                bends[its] = self.solver.towards(data, leg, ball, self.shifts[leg])
        return bends

    def _speeds(self, moment: int) -> tuple[Array, Array]:
        """How fast the reference moves and turns."""
        to = self.reference
        one, two = max(moment - 1, 0), min(moment + 1, len(to.com_m) - 1)
        span = to.step_s * max(two - one, 1)
        return (
            (to.com_m[two] - to.com_m[one]) / span,
            rotation_between(to.turn[two], to.turn[one]) / span,
        )

    def _touched(self) -> float:
        """What the ground carries, up [N]; counts steps in which anything but a foot touches it."""
        body, data, up, local, bumped = self.body, self.data, 0.0, np.zeros(6), False
        for index in range(data.ncon):
            contact = data.contact[index]
            mujoco.mj_contactForce(body.model, data, index, local)
            force = contact.frame.reshape(3, 3).T @ local[:3]  # on the second
            first = body.model.geom_bodyid[contact.geom1] == 0
            up += float(force[2]) * (1.0 if first else -1.0)
            shape = contact.geom2 if first else contact.geom1
            bumped |= shape not in body.balls
        self.bumped += bumped
        return up

    def _measure(self, moment: int) -> None:
        data, to = self.data, self.reference
        self.errors.append(float(np.linalg.norm(self._com() - to.com_m[moment])))
        turn = rotation_between(to.turn[moment], data.qpos[3:7])
        self.turned = max(self.turned, float(np.linalg.norm(turn)))
        after = round(self.settings.slide_after_s / to.step_s)
        for foot, body in enumerate(self.body.feet):
            ball, turn = data.geom_xpos[self.body.balls[foot]].copy(), data.xquat[body].copy()
            since, slip = self.touched[foot], self.slips[foot]
            if not to.stands[moment, foot]:
                since = None
            elif since is None:
                since, slip = len(self.errors), np.zeros(3)
            elif len(self.errors) - since > after:
                was, turned = self.before[foot]
                arm = self.body.radii_m[foot] * to.normals[moment, foot]
                slip = slip + ball - was - cross(rotation_between(turn, turned), arm)
                self.slid = max(self.slid, float(np.linalg.norm(slip)))
            self.touched[foot], self.slips[foot], self.before[foot] = since, slip, (ball, turn)

    def _com(self) -> Array:
        return np.asarray(self.data.subtree_com[self.body.base])

    def _off(self, moment: int, bounds: Bounds) -> bool:
        """Whether the body is farther off the file's moment than this, or nowhere."""
        to = self.reference
        off = float(np.linalg.norm(self._com() - to.com_m[moment]))
        turn = float(np.linalg.norm(rotation_between(to.turn[moment], self.data.qpos[3:7])))
        return not (off <= bounds.com_m and turn <= bounds.rotation_rad)

    def _row(
        self,
        fell: float | None,
        *,
        stood: bool,
        held_n: float | None = None,
        of_s: float | None = None,
    ) -> Row:
        errors, step = np.array(self.errors), self.reference.step_s
        weight = self.body.mass_kg * float(np.linalg.norm(self.body.model.opt.gravity))
        last = self.normal_n[-max(1, round(STILL_S / step)) :]
        return Row(
            stood=stood,
            fell_s=None if fell is None else round(fell, 3),
            of_s=round(len(self.reference.com_m) * step if of_s is None else of_s, 2),
            rms_mm=round(1e3 * float(np.sqrt((errors**2).mean())), 2),
            most_mm=round(1e3 * float(errors.max()), 2),
            end_mm=round(1e3 * float(errors[-1]), 2),
            turned_rad=round(self.turned, 4),
            slide_mm=round(1e3 * self.slid, 2),
            bumped_s=round(self.bumped * self.settings.physics_s, 3),
            torque_share=round(self.share, 3),
            missed_mm=round(1e3 * self.told.missed_m, 3),
            carried=round(float(np.mean(last)) / weight, 4),
            held_n=None if held_n is None else round(held_n, 2),
        )
