"""Forged walks, by somebody who had not read the verifier: kinds as in _outside_plans."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from _outside_files import Array, NoForgery, Opened
from _outside_judge import more, outside
from _outside_level import G_M_S2, eased, level, refined

Kind = Callable[[Opened, float, np.random.Generator], str]


def glides(walk: Opened, size: float, rng: np.random.Generator) -> str:
    """On level ground without friction it starts at rest, goes somewhere slowly, and stops."""
    speed = 0.0195 * size
    level(walk, duration_s=float(rng.uniform(20.0, 60.0)), speed_m_s=max(speed, 0.004))
    went = float(np.linalg.norm(walk.arrays["torso_m"][-1] - walk.arrays["torso_m"][0]))
    return more("way of the centre of mass without any horizontal force", went, 0.02, "m")


def turns_on_ice(walk: Opened, size: float, rng: np.random.Generator) -> str:
    """On level ground without friction it starts at rest, turns round slowly, and stops."""
    turn = 0.15 + 6.0 * size
    level(walk, duration_s=10.0 + 4.0 * turn, turn_rad=turn)
    return more("turn without any moment about the vertical", turn, 0.05, "rad")


def long_legs(walk: Opened, size: float, rng: np.random.Generator) -> str:
    """The trunk is carried higher than the URDF's legs reach; the boxes in the file are as large as
    that.
    """
    for foot in walk.robot["feet"]:
        foot["reach_min_m"] = [value - 1.0 for value in foot["reach_min_m"]]
        foot["reach_max_m"] = [value + 1.0 for value in foot["reach_max_m"]]
    walk.arrays["torso_m"][:, 2] += 0.2 + 0.1 * size
    stand = np.abs(walk.arrays["feet_m"] - walk.arrays["torso_m"][:, None])[..., 2].max()
    return more(
        "foot below the centre of mass, with legs of 0.43 m from 0 m under it",
        stand / 0.43,
        0.5,
        "legs",
    )


def massive(walk: Opened, size: float, rng: np.random.Generator) -> str:
    """The file's robot has another mass than its URDF's links."""
    factor = float(rng.choice([1.02 + size, 1.0 / (1.02 + size)]))
    walk.robot["mass_kg"] *= factor
    walk.robot["inertia_kgm2"] = (factor * np.array(walk.robot["inertia_kgm2"])).tolist()
    walk.arrays["forces_n"] *= factor
    return more("mass over that of the URDF's links", abs(factor - 1.0), 1e-3, "")


def tall(walk: Opened, size: float, rng: np.random.Generator) -> str:
    """The file's robot stands higher than its URDF, and moments are judged over that; a moment is
    missing.
    """
    walk.robot["stand_height_m"] *= 4.0 + 20.0 * size
    shift = 0.02 + 0.02 * size
    for name in ("start", "goal"):
        walk.head["question"][name][1] += shift
    walk.arrays["torso_m"][:, 1] += shift
    return more(
        "moment about the trunk over the whole walk, as an arm of the weight", shift, 0.005, "m"
    )


def thin(walk: Opened, size: float, rng: np.random.Generator) -> str:
    """The file's robot has no trunk to speak of, its URDF has one; the ground goes through that."""
    walk.robot["trunk_half_m"] = [1e-3, 1e-3, 1e-3]
    x, y = walk.arrays["terrain_x_m"], walk.arrays["terrain_y_m"]
    at = walk.arrays["torso_m"][int(rng.integers(600, 1400))]
    i, j = np.argmin(np.abs(x - at[0])), np.argmin(np.abs(y - at[1]))
    walk.arrays["terrain_heights_m"][i, j] = at[2] - 0.03 + 0.02 * size
    return more(
        "peak of the ground over the trunk's lower face, 37 mm under its centre of mass",
        0.007 + 0.02 * size,
        1e-3,
        "m",
    )


def feeble(walk: Opened, size: float, rng: np.random.Generator) -> str:
    """Motors that could not hold a toe's own force a centimetre away from it."""
    effort = 0.05 + 0.2 * (1.0 - size)
    walk.urdf('effort="[^"]*"', f'effort="{effort}"')
    held = float(np.linalg.norm(walk.arrays["forces_n"], axis=-1).max())
    # three joints at their limits hold at most a force of 3 τ over the knee's arm, the largest of
    # the three: see bound
    bound = 3.0 * effort / 0.1
    return more("force of a foot over what three joints hold at 0.1 m", held / bound, 1.0, "")


def sluggish(walk: Opened, size: float, rng: np.random.Generator) -> str:
    """Joints slower than a foot's speed in the body's frame needs: three axes, none farther than
    0.55 m from it.
    """
    limit = 0.3 - 0.25 * size
    walk.urdf('velocity="[^"]*"', f'velocity="{limit}"')
    arms = np.einsum(
        "kji,kej->kei",
        walk.arrays["rotation"],
        walk.arrays["feet_m"] - walk.arrays["torso_m"][:, None],
    )
    speed = np.linalg.norm(np.diff(arms, axis=0), axis=-1).max() / 0.005
    return more("foot's speed over what joints give it", float(speed) / (3 * 0.55 * limit), 0.5, "")


def short(walk: Opened, size: float, rng: np.random.Generator) -> str:
    """Three samples, and the goal elsewhere."""
    walk.cut(slice(0, 3))
    walk.arrays["torso_m"][2, 0] += 0.01 + size
    walk.head["question"]["goal"] = walk.arrays["torso_m"][2, :2].tolist()
    return more("speed between two samples", (0.01 + size) / 0.005, 0.9, "m/s")


def shivers(walk: Opened, size: float, rng: np.random.Generator) -> str:
    """The trunk turns to and fro at every sample, which a central difference does not see."""
    angle = 2e-4 + 1e-2 * size
    signs = _inside(walk) * np.where(np.arange(len(walk.arrays["times_s"])) % 2, angle, -angle)
    c, s, o = np.cos(signs), np.sin(signs), np.zeros_like(signs)
    turn = np.stack(
        [np.stack([c, -s, o], -1), np.stack([s, c, o], -1), np.stack([o, o, o + 1], -1)], -2
    )
    walk.arrays["rotation"] = walk.arrays["rotation"] @ turn
    return more("angular acceleration", 4.0 * angle / 0.005**2, 15.0, "rad/s²")


def hops(walk: Opened, size: float, rng: np.random.Generator) -> str:
    """The trunk goes up and down at every sample."""
    height = 2e-5 + 1e-3 * size
    walk.arrays["torso_m"][:, 2] += _inside(walk) * np.where(
        np.arange(len(walk.arrays["times_s"])) % 2, height, -height
    )
    return more("acceleration", 4.0 * height / 0.005**2, 0.1, "m/s²")


def flutters(walk: Opened, size: float, rng: np.random.Generator) -> str:
    """A fine grid of samples, at which feet in the air go to and fro at some metres a second:
    thousands of g.
    """
    fine = 10
    refined(walk, fine)
    step = 0.005 / fine
    shift = 1e-4 + 1e-3 * size
    air = ~walk.arrays["contact"]
    deep = air.copy()
    for back in range(1, 20 * fine, 5):
        deep[back:] &= air[:-back]
        deep[:-back] &= air[back:]
    signs = np.where(np.arange(len(air)) % 2, shift, -shift)
    walk.arrays["feet_m"][..., 0] += np.where(deep, signs[:, None], 0.0)
    if not deep.any():
        raise NoForgery("no foot is in the air long enough")
    return more("acceleration of a foot", 4.0 * shift / step**2, 1000.0, "m/s²")


def swaps(walk: Opened, size: float, rng: np.random.Generator) -> str:
    """Feet slide with the body, and stand in turns, a few samples each."""
    every = int(rng.integers(1, 8))
    turn = (np.arange(len(walk.arrays["times_s"])) // every) % 2 == 0
    walk.arrays["contact"] = np.stack([turn, ~turn, ~turn, turn], axis=1)
    _slide(walk, 0.2 + 1.5 * size)
    return more("way that feet slide", 0.2 + 1.5 * size, 0.01, "m")


def drags(walk: Opened, size: float, rng: np.random.Generator) -> str:
    """Feet slide with the body, and stand all along."""
    _slide(walk, 0.02 + 1.0 * size)
    return more("way that feet slide", 0.02 + size, 0.005, "m")


def slick(walk: Opened, size: float, rng: np.random.Generator) -> str:
    """The ground is slicker than what feet ask of it."""
    walk.head["question"]["friction"] = 0.35 * (1.0 - size)
    worst = 0.0
    normals = _normals(walk)
    for row, foot in zip(*np.nonzero(walk.arrays["contact"]), strict=True):
        worst = max(
            worst,
            outside(
                walk.arrays["forces_n"][row, foot],
                normals[row, foot],
                walk.head["question"]["friction"],
            ),
        )
    return more("tangential force beyond friction", worst, 0.3, "N")


def airborne(walk: Opened, size: float, rng: np.random.Generator) -> str:
    """Feet that are in the air carry."""
    rows = rng.choice(np.nonzero(~walk.arrays["contact"].all(axis=1))[0], size=5)
    for row in rows:
        foot = int(np.nonzero(~walk.arrays["contact"][row])[0][0])
        walk.arrays["forces_n"][row, foot, 2] += 1.0 + 100.0 * size
    return more("force in the air", 1.0 + 100.0 * size, 0.3, "N")


def weightless(walk: Opened, size: float, rng: np.random.Generator) -> str:
    """Part of the weight is missing for a while."""
    begin, rows = int(rng.integers(400, 1200)), int(24 + 200 * size)
    walk.arrays["forces_n"][begin : begin + rows] *= 0.6 - 0.6 * size
    return more("change of speed that nothing makes", 0.4 * rows * 0.005 * G_M_S2, 0.1, "m/s")


def rare(walk: Opened, size: float, rng: np.random.Generator) -> str:
    """Few samples, whose feet are anywhere between them."""
    walk.cut(slice(None, None, 2 + int(50 * size)))
    return "nothing is said of the motion between samples that are 10 ms apart or more"


def rushed(walk: Opened, size: float, rng: np.random.Generator) -> str:
    """Played faster than forces are for."""
    factor = 0.5 - 0.4 * size
    walk.arrays["times_s"] = walk.arrays["times_s"] * factor
    away = np.diff(walk.arrays["torso_m"], n=2, axis=0)[:, 0] * (1.0 / factor**2 - 1.0) / 0.005**2
    return more("acceleration that no force makes", float(np.abs(away).max()), 0.1, "m/s²")


def backward(walk: Opened, size: float, rng: np.random.Generator) -> str:
    """Time stands still or goes back for some samples."""
    begin, rows = int(rng.integers(100, 1500)), int(2 + 100 * size)
    walk.arrays["times_s"][begin : begin + rows] = walk.arrays["times_s"][begin : begin + rows][
        ::-1
    ].copy()
    return "time goes backward"


def mirrored(walk: Opened, size: float, rng: np.random.Generator) -> str:
    """The trunk is its own mirror image for some samples."""
    begin, rows = int(rng.integers(0, 1500)), int(1 + 300 * size)
    walk.arrays["rotation"][begin : begin + rows, :, 2] *= -1.0
    return "a rotation of determinant -1"


def buried(walk: Opened, size: float, rng: np.random.Generator) -> str:
    """The ground is higher than it was, somewhere on the way: the trunk is in it."""
    x, y = walk.arrays["terrain_x_m"], walk.arrays["terrain_y_m"]
    row = int(rng.integers(600, 1400))
    at = walk.arrays["torso_m"][row]
    near = np.abs(x - at[0])[:, None] + np.abs(y - at[1])[None]
    i, j = np.unravel_index(np.argmin(near), near.shape)
    peak = at[2] - 0.1 * (1.0 - size)
    walk.arrays["terrain_heights_m"][i, j] = peak
    half = walk.robot["trunk_half_m"][2]
    return more("peak above the trunk's lower face", peak - (at[2] - half), 0.005, "m")


def _slide(walk: Opened, metres: float) -> None:
    level_contact = walk.arrays["contact"].copy()
    times = walk.arrays["times_s"]
    level(walk, duration_s=float(times[-1]), friction=0.75)
    way = metres * eased((times - 0.5) / (times[-1] - 1.0))
    for name in ("torso_m", "feet_m"):
        walk.arrays[name][..., 0] = walk.arrays[name][:1, ..., 0] + way.reshape(
            -1, *[1] * (walk.arrays[name].ndim - 2)
        )
    walk.arrays["feet_m"][..., 1:] = walk.arrays["feet_m"][:1, :, 1:]
    walk.arrays["contact"] = (
        level_contact if not level_contact.all() else np.ones_like(level_contact)
    )
    walk.arrays["terrain_x_m"] = np.arange(-1.5, metres + 1.55, 0.05)
    walk.arrays["terrain_heights_m"] = np.zeros(
        (walk.arrays["terrain_x_m"].size, walk.arrays["terrain_y_m"].size)
    )
    walk.head["question"]["goal"] = walk.arrays["torso_m"][-1, :2].tolist()


def _inside(walk: Opened) -> Array:
    inside = np.ones(len(walk.arrays["times_s"]))
    inside[:200] = inside[-200:] = 0.0
    return inside


def _normals(walk: Opened) -> Array:
    x, y, z = (walk.arrays[f"terrain_{name}"] for name in ("x_m", "y_m", "heights_m"))
    i = np.clip(np.searchsorted(x, walk.arrays["feet_m"][..., 0]), 1, len(x) - 1)
    j = np.clip(np.searchsorted(y, walk.arrays["feet_m"][..., 1]), 1, len(y) - 1)
    along, across = (
        (z[i, j] - z[i - 1, j]) / (x[i] - x[i - 1]),
        (z[i, j] - z[i, j - 1]) / (y[j] - y[j - 1]),
    )
    normal = np.stack([-along, -across, np.ones_like(along)], axis=-1)
    return normal / np.linalg.norm(normal, axis=-1, keepdims=True)


WALKS: tuple[Kind, ...] = (
    glides,
    turns_on_ice,
    short,
    shivers,
    hops,
    flutters,
    swaps,
    drags,
    slick,
    airborne,
    weightless,
    rare,
    rushed,
    backward,
    mirrored,
    buried,
)
"""Of a walk by a robot of numbers alone."""
LEGGED: tuple[Kind, ...] = (long_legs, massive, tall, thin, feeble, sluggish)
"""Of a walk by a robot of a URDF."""
