"""Forged walks: each a fault in an honest crawl, as small as asked for, with the rest repaired
where it can be.

A kind takes the honest walk, a size in units of what the verifier writes down as its tolerance, and
``rng`` for where.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from stancekit import Motion
from stancekit.planners.answer.trajectory import STEP_S
from stancekit.planners.files.arrays import Array
from stancekit.planners.terrain.heightfield import HeightField

from .crawl import balanced

Forge = Callable[[Motion, float, np.random.Generator], Motion]
KINDS: dict[str, Forge] = {}


def kind(forge: Forge) -> Forge:
    """Note a forgery under its name."""
    KINDS[forge.__name__.replace("_", " ")] = forge
    return forge


def changed(walk: Motion, **changes: Any) -> Motion:
    """The walk with other arrays, or asked otherwise."""
    return replace(
        walk.asked(**{name: changes.pop(name) for name in vars(walk.problem) if name in changes}),
        **changes,
    )


def rebalanced(walk: Motion, feet: Array | None = None, contact: Array | None = None) -> Motion:
    """With feet or contacts of its own, and forces that hold the body all the same."""
    toes = walk.feet_m if feet is None else feet
    down = walk.contact if contact is None else contact
    return replace(
        walk, feet_m=toes, contact=down, forces_n=balanced(walk.robot, walk.torso_m, toes, down)
    )


def swings(walk: Motion) -> list[tuple[int, int, int]]:
    """(foot, first, last) of the samples of every swing."""
    found = []
    for foot in range(walk.contact.shape[1]):
        air = np.flatnonzero(~walk.contact[:, foot])
        found.append((foot, int(air[0]), int(air[-1])))
    return found


def a_swing(walk: Motion, rng: np.random.Generator) -> tuple[int, int, int]:
    """One of them."""
    return swings(walk)[rng.integers(4)]


def a_moment(walk: Motion, rng: np.random.Generator, room: int = 60) -> int:
    """A sample away from both ends."""
    return int(rng.integers(room, walk.samples - room))


# --------------------------------------------------------------------------------------------- feet
# that slide


@kind
def skating(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """All feet slide ahead with the body, and contacts swap from pair to pair every few samples."""
    ahead = 0.05 * size * (np.arange(walk.samples) / walk.samples)[:, None] * [1.0, 0.0, 0.0]
    contact, every = np.zeros_like(walk.contact), int(rng.integers(1, 9))
    turn = (np.arange(walk.samples) // every) % 2 == 0
    contact[turn[:, None] & [True, False, False, True]] = contact[
        ~turn[:, None] & [False, True, True, False]
    ] = True
    torso = walk.torso_m[:1] + ahead
    feet = walk.feet_m[:1] + ahead[:, None]
    forces = np.where(contact[..., None], [0.0, 0.0, 0.5 * walk.robot.weight_n], 0.0)
    return changed(
        walk, torso_m=torso, feet_m=feet, contact=contact, forces_n=forces, goal=torso[-1, :2]
    )


@kind
def skating_on_ice(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """The same without any friction."""
    return changed(skating(walk, size, rng), friction=0.0)


@kind
def sliding(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """A foot slides by so many millimetres in half a second while it stands, and stays there."""
    foot, first, _ = a_swing(walk, rng)
    begin = int(rng.integers(10, first - 110)) if first > 130 else 10
    share = np.clip((np.arange(walk.samples) - begin) / 100, 0.0, 1.0) * (
        np.arange(walk.samples) < first
    )
    feet = np.array(walk.feet_m)
    way = rng.uniform(0.0, 2.0 * np.pi)
    feet[:first, foot, :2] += 1e-3 * size * share[:first, None] * [np.cos(way), np.sin(way)]
    return rebalanced(walk, feet)


@kind
def slipping_at_once(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """A foot jumps while it stands, by less than a slip, faster than a foot that stands may be."""
    feet, at, foot = np.array(walk.feet_m), int(rng.integers(5, 30)), int(rng.integers(4))
    feet[at:, foot, 0] += 0.01 * size * STEP_S
    return rebalanced(walk, feet)


@kind
def swapped_contacts(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """All feet rest on the ground, and contacts swap so fast that no foot stands or swings for a
    tenth of a second.
    """
    every, contact = max(1, int(20 / size)), np.array(walk.contact)
    begin = int(rng.integers(20, 60))
    for k in range(begin, begin + 6 * every):
        contact[k, [0, 3] if ((k - begin) // every) % 2 else [1, 2]] = False
    return rebalanced(walk, contact=contact)


@kind
def short_stance(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """A foot touches the ground in the middle of its swing for an instant, and carries."""
    foot, first, last = a_swing(walk, rng)
    middle, half = (first + last) // 2, max(1, int(10 / size))
    contact, feet = np.array(walk.contact), np.array(walk.feet_m)
    contact[middle - half : middle + half, foot] = True
    feet[middle - half : middle + half, foot, 2] = 0.0
    return rebalanced(walk, feet, contact)


@kind
def short_swing(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """A foot is said to be in the air for an instant, and stays where it is."""
    at, foot, contact = int(rng.integers(5, 30)), int(rng.integers(4)), np.array(walk.contact)
    contact[at : at + max(1, int(18 / size)), foot] = False
    return rebalanced(walk, contact=contact)


# --------------------------------------------------------------------------------------------- ice
# and weight


@kind
def ice(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """The honest forces on ground without friction."""
    return changed(walk, friction=0.0)


@kind
def little_friction(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """The honest forces on ground of so little friction that the largest of them slides."""
    normal, flat = walk.forces_n[..., 2], np.linalg.norm(walk.forces_n[..., :2], axis=-1)
    beyond = 1e-3 * size * walk.robot.weight_n
    needed = ((flat - beyond) / np.maximum(normal, 1.0))[walk.contact & (normal > 1.0)]
    return changed(walk, friction=max(0.0, float(needed.max())))


@kind
def residual_as_friction(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """On ice, the horizontal forces left out of the file: the balances lack what only friction
    could give.
    """
    forces = walk.forces_n * [0.0, 0.0, 1.0]
    return changed(walk, forces_n=forces, friction=0.0)


@kind
def weight_missing(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """A share of the weight is missing for a while."""
    share, forces = rng.uniform(0.15, 0.35), np.array(walk.forces_n)
    lasts = max(2, int(0.01 * size / share / STEP_S) + 1)
    at = a_moment(walk, rng, 30 + lasts)
    forces[at : at + lasts] *= 1.0 - share
    return changed(walk, forces_n=forces)


@kind
def weight_missing_always(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """A small share is missing all the time."""
    return changed(walk, forces_n=walk.forces_n * (1.0 - 0.016 * size))


@kind
def weight_too_much(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """The feet press more than the robot weighs, all the time."""
    return changed(walk, forces_n=walk.forces_n * (1.0 + 0.016 * size))


@kind
def pulse(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """One sample of a force that nothing answers."""
    forces, at = np.array(walk.forces_n), a_moment(walk, rng)
    standing = np.flatnonzero(walk.contact[at])
    forces[at, standing, 2] += 0.4 * size * walk.robot.weight_n / len(standing)
    return changed(walk, forces_n=forces)


@kind
def hop_without_impulse(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """The body goes up and down by an impulse that no foot gives."""
    at, lasts = a_moment(walk, rng, 150), 20
    share = np.clip((np.arange(walk.samples) - at) / lasts, 0.0, 1.0)
    bump = 64.0 * (share * (1.0 - share)) ** 3
    high = 0.01 * size * 9.81 * lasts * STEP_S / 3.0
    return changed(walk, torso_m=walk.torso_m + (min(high, 0.03) * bump)[:, None] * [0.0, 0.0, 1.0])


@kind
def floating(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """No foot carries for some samples, and the body stays where it is."""
    at, lasts = a_moment(walk, rng), max(2, int(size))
    forces = np.array(walk.forces_n)
    forces[at : at + lasts] = 0.0
    return changed(walk, forces_n=forces)


@kind
def heavier_robot(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """Another mass under the same forces."""
    return changed(
        walk, robot=replace(walk.robot, mass_kg=walk.robot.mass_kg * (1.0 + 0.02 * size))
    )


@kind
def moment_missing(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """Front feet carry a little more than the balance of moments gives them, hind feet less, all
    the time.
    """
    forces = np.array(walk.forces_n)
    more = 2e-3 * size * walk.robot.weight_n * walk.robot.stand_height_m / 0.72
    for pair, sign in (([0, 1], 1.0), ([2, 3], -1.0)):
        share = walk.contact[:, pair] / walk.contact[:, pair].sum(axis=1, keepdims=True)
        forces[:, pair, 2] += sign * 2.0 * more * share
    return changed(walk, forces_n=forces)


@kind
def moment_pulse(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """One sample of a moment that nothing answers."""
    forces, at = np.array(walk.forces_n), a_moment(walk, rng)
    down = walk.contact[at, [0, 1]], walk.contact[at, [2, 3]]
    more = 0.3 * size * walk.robot.weight_n * walk.robot.stand_height_m / 0.72
    forces[at, [0, 1], 2] += more * down[0] / down[0].sum()
    forces[at, [2, 3], 2] -= more * down[1] / down[1].sum()
    return changed(walk, forces_n=forces)


@kind
def time_squeezed(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """The same motion and forces in less time."""
    return changed(walk, times_s=walk.times_s / (1.0 + 0.25 * size))


@kind
def played_backwards_forces(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """The forces of another moment of the walk."""
    return changed(walk, forces_n=np.roll(walk.forces_n, round(20 * size), axis=0))


# ----------------------------------------------------------------------------------------------
# forces of feet


@kind
def outside_the_cone(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """Two feet press against each other, harder than their cones allow."""
    forces, at = np.array(walk.forces_n), int(rng.integers(5, 30))
    beyond = walk.problem.friction * forces[at, :, 2] + 1e-3 * size * walk.robot.weight_n
    push = float(beyond[[0, 1]].max())
    forces[at : at + 20, 0, 1] -= push
    forces[at : at + 20, 1, 1] += push
    return changed(walk, forces_n=forces)


@kind
def pulling(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """A foot without suction pulls, and the others carry more."""
    forces, at = np.array(walk.forces_n), int(rng.integers(5, 30))
    more = forces[at, 0, 2] + 1e-3 * size * walk.robot.weight_n
    forces[at : at + 20, :, 2] += more * np.array([-1.0, 1.0, 1.0, -1.0])
    return changed(
        walk, forces_n=forces, friction=0.0 if rng.random() < 0.5 else walk.problem.friction
    )


@kind
def sucking(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """A foot that sticks pulls with more than its suction."""
    forces, at, sucks = np.array(walk.forces_n), int(rng.integers(5, 30)), rng.uniform(0.0, 100.0)
    more = forces[at, 0, 2] + sucks + 1e-3 * size * walk.robot.weight_n
    forces[at : at + 20, :, 2] += more * np.array([-1.0, 1.0, 1.0, -1.0])
    return changed(
        walk, forces_n=forces, suction_n=sucks, adhesive=np.array([True, False, False, True])
    )


@kind
def shearing(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """Feet that stick press against each other with more than suction and friction hold."""
    forces, at, sucks = np.array(walk.forces_n), int(rng.integers(5, 30)), rng.uniform(0.0, 100.0)
    push = float(
        (walk.problem.friction * (forces[at, :2, 2] + sucks)).max()
        + 1e-3 * size * walk.robot.weight_n
    )
    forces[at : at + 20, 0, 1] -= push
    forces[at : at + 20, 1, 1] += push
    return changed(walk, forces_n=forces, suction_n=sucks, adhesive=np.ones(4, dtype=bool))


@kind
def squeezing(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """Feet that stick press against each other with a force that no leg has."""
    forces, at, push = (
        np.array(walk.forces_n),
        int(rng.integers(5, 30)),
        2.0 * size * walk.robot.weight_n,
    )
    forces[at : at + 20, 0, 1] -= push
    forces[at : at + 20, 1, 1] += push
    return changed(walk, forces_n=forces, suction_n=1e5, adhesive=np.ones(4, dtype=bool))


@kind
def pressing_in_the_air(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """A swinging foot carries."""
    foot, first, last = a_swing(walk, rng)
    forces = np.array(walk.forces_n)
    forces[(first + last) // 2, foot, 2] = 1e-3 * size * walk.robot.weight_n
    return changed(walk, forces_n=forces)


@kind
def standing_in_the_air(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """A foot that is said to stand is above the ground, or below it."""
    feet, foot = np.array(walk.feet_m), int(rng.integers(4))
    stands = walk.contact[:, foot]
    feet[stands, foot, 2] += rng.choice([-1.0, 1.0]) * 1e-3 * size
    return rebalanced(walk, feet)


@kind
def contact_before_touching(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """A foot carries before it has come down."""
    foot, _, last = a_swing(walk, rng)
    heights = walk.feet_m[:, foot, 2]
    early = next(k for k in range(last, 0, -1) if heights[k] >= 1e-3 * size)
    contact = np.array(walk.contact)
    contact[early:, foot] = True
    return rebalanced(walk, contact=contact)


# ----------------------------------------------------------------------------------------------------
# swings


@kind
def through_the_ground(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """A swinging foot dives into the ground."""
    foot, first, last = a_swing(walk, rng)
    share = np.linspace(0.0, 1.0, last - first + 3)[1:-1]
    feet, dip = np.array(walk.feet_m), np.exp(-(((share - rng.uniform(0.3, 0.7)) / 0.1) ** 2))
    feet[first : last + 1, foot, 2] -= dip * (feet[first : last + 1, foot, 2] + 1e-3 * size)
    return changed(walk, feet_m=feet)


@kind
def dragged(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """A foot that is said to swing goes along the ground, as far as the step is long."""
    foot, first, last = a_swing(walk, rng)
    feet = np.array(walk.feet_m)
    feet[first : last + 1, foot, 2] = rng.uniform(0.0, 5e-4)
    return changed(walk, feet_m=feet)


@kind
def low_swing(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """A swing is lower than anything that could be called one."""
    foot, first, last = a_swing(walk, rng)
    feet = np.array(walk.feet_m)
    feet[first : last + 1, foot, 2] *= 5e-3 / size / 0.05
    return changed(walk, feet_m=feet)


@kind
def tripping(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """A swinging foot touches the ground half-way, smoothly."""
    foot, first, last = a_swing(walk, rng)
    share = np.linspace(0.0, 1.0, last - first + 3)[1:-1]
    feet, dip = np.array(walk.feet_m), np.exp(-(((share - 0.5) / 0.08) ** 2))
    feet[first : last + 1, foot, 2] += dip * (1e-3 / size - feet[first : last + 1, foot, 2])
    return changed(walk, feet_m=feet)


@kind
def through_a_post(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """A post stands in the way of a swinging foot."""
    foot, first, last = a_swing(walk, rng)
    x, y = walk.feet_m[(first + last) // 2, foot, :2]
    high = walk.feet_m[(first + last) // 2, foot, 2] + 1e-3 * size
    post = HeightField.from_function(
        lambda u, v: high * np.exp(-(((u - x) / 0.012) ** 2) - ((v - y) / 0.012) ** 2),
        1.2,
        0.005,
        name="level",
    )
    return changed(walk, terrain=post)


# ----------------------------------------------------------------------------------------------
# body and ends


@kind
def teleport(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """The body is somewhere else from one sample to the next."""
    at, ahead = a_moment(walk, rng), 5e-3 * size
    torso = np.array(walk.torso_m)
    torso[at:, 0] += ahead
    return changed(walk, torso_m=torso, goal=torso[-1, :2])


@kind
def foot_teleport(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """A swinging foot is somewhere else from one sample to the next."""
    foot, first, last = a_swing(walk, rng)
    feet = np.array(walk.feet_m)
    feet[(first + last) // 2, foot, 1] += 5e-3 * size / 2.0
    return changed(walk, feet_m=feet)


@kind
def rushing_foot(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """A foot goes from its place and back within a few samples, faster than legs are."""
    foot, first, last = a_swing(walk, rng)
    feet = np.array(walk.feet_m)
    feet[(first + last) // 2, foot, 1] += 10.0 * size * STEP_S
    return changed(walk, feet_m=feet)


@kind
def spinning(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """The body turns to one side and back by moments that nobody gives."""
    at, lasts = a_moment(walk, rng, 100), 30
    share = np.clip((np.arange(walk.samples) - at) / lasts, 0.0, 1.0)
    turn = 0.1 * size * 64.0 * (share * (1.0 - share)) ** 3
    return changed(walk, rotation=Rotation.from_rotvec(turn[:, None] * [0.0, 0.0, 1.0]).as_matrix())


@kind
def facing_elsewhere(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """The body does not face where it is asked to, all the way."""
    turned = Rotation.from_euler("z", rng.choice([-1.0, 1.0]) * 0.01 * size).as_matrix()
    return changed(walk, rotation=np.tile(turned, (walk.samples, 1, 1)))


def part(walk: Motion, first: int, end: int) -> Motion:
    """Some samples, with start and goal where they are."""
    rows = {
        name: getattr(walk, name)[first:end]
        for name in ("torso_m", "rotation", "feet_m", "forces_n", "contact")
    }
    torso = rows["torso_m"]
    return changed(
        walk,
        times_s=walk.times_s[: end - first],
        start=torso[0, :2],
        goal=torso[-1, :2],
        **rows,
    )


def speeding(walk: Motion, speed: float) -> int:
    """The first sample at which the body is this fast [m/s]."""
    speeds = np.linalg.norm(np.diff(walk.torso_m, axis=0), axis=1) / STEP_S
    return int(np.flatnonzero(speeds > speed)[0])


@kind
def starting_in_motion(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """The walk begins while the body moves."""
    return part(walk, speeding(walk, 5e-3 * size), walk.samples)


@kind
def ending_in_motion(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """The walk ends while the body moves."""
    return part(walk, 0, speeding(walk, 5e-3 * size) + 2)


@kind
def leaning_at_the_end(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """The walk ends with the acceleration of a fall that has not begun."""
    torso, late = np.array(walk.torso_m), np.arange(walk.samples) - walk.samples + 21
    torso[:, 0] += 0.5 * 0.02 * size * 9.81 * (STEP_S * np.clip(late - 10, 0, None)) ** 2
    return rebalanced(changed(walk, torso_m=torso, goal=torso[-1, :2]))


@kind
def out_of_reach(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """The body is so high that legs are too long, or so low that they are too short."""
    body, foot = np.array(walk.torso_m), walk.robot.feet[0]
    reach = -foot.reach_min_m[2] if rng.random() < 0.5 else -foot.reach_max_m[2]
    body[:, 2] = reach + 3e-3 * size * (1.0 if reach == -foot.reach_min_m[2] else -1.0)
    return rebalanced(changed(walk, torso_m=body))


@kind
def trunk_in_a_stone(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """A stone is where the trunk goes."""
    high = walk.robot.stand_height_m - walk.robot.trunk_half_m[2] + 1e-3 * size
    stone = HeightField.from_function(
        lambda u, v: high * np.exp(-((u / 0.06) ** 2) - (v / 0.06) ** 2), 1.2, 0.02, name="level"
    )
    return changed(walk, terrain=stone)


@kind
def another_goal(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """The walk ends beside its goal, or begins beside its start."""
    way = rng.uniform(0.0, 2.0 * np.pi)
    off = 5e-3 * size * np.array([np.cos(way), np.sin(way)])
    name = "goal" if rng.random() < 0.5 else "start"
    return changed(walk, **{name: getattr(walk.problem, name) + off})


@kind
def off_the_map(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """The terrain ends before the walk does."""
    x = float(walk.feet_m[..., 0].max()) - 1e-3 * size
    lines, across = np.linspace(x - 2.0, x, 9), np.linspace(-1.0, 1.0, 9)
    return changed(walk, terrain=HeightField(lines, across, np.zeros((9, 9)), "level"))


@kind
def another_terrain(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """The same walk over ground that is inclined, or wavy."""
    slope = 2e-3 * size / 0.2
    bent = HeightField.from_function(
        lambda u, v: slope * (u if size < 3 else 0.3 * np.sin(4.0 * v)), 2.0, 0.1
    )
    return changed(walk, terrain=bent)


@kind
def another_slope(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """The whole walk turned onto a slope that its friction does not hold, weight and all."""
    steep = float(np.arctan(walk.problem.friction) + 0.02 * size)
    turn = Rotation.from_euler("y", -steep).as_matrix()
    ground = HeightField.from_function(lambda u, v: np.tan(steep) * u, 2.0, 0.25, name="slope")
    feet, torso = walk.feet_m @ turn.T, walk.torso_m @ turn.T
    forces = balanced(walk.robot, torso, feet, walk.contact)
    heading = float(np.arctan2(turn[1, 0], turn[0, 0]))
    return changed(
        walk,
        feet_m=feet,
        torso_m=torso,
        rotation=turn @ walk.rotation,
        forces_n=forces,
        terrain=ground,
        start=torso[0, :2],
        goal=torso[-1, :2],
        heading_rad=heading,
    )


@kind
def stretched_body(walk: Motion, size: float, rng: np.random.Generator) -> Motion:
    """What is said to be a rotation is none, or a reflection."""
    if rng.random() < 0.5:
        return changed(walk, rotation=walk.rotation * np.array([1.0, 1.0, -1.0]))
    return changed(walk, rotation=walk.rotation * (1.0 + 1e-6 * size))
