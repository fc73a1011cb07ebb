"""Write configs/robots/anymal.urdf and anymal.srdf: legs for the boxes of
configs/robots/anymal.yaml.

    python benchmarks/anymal_urdf.py

Joints, link lengths and the masses of the legs are public figures of ANYmal B, those of the URDF of
example-robot-data 6.0.0 (anymal_b_simple_description, BSD-3-Clause), rounded: HAA .277 m ahead of
the middle and .116 m beside it, HFE .0635 m farther and .041 m outward, thigh .25 m down and .109 m
outward, sole .1 m ahead of the knee and .329 m below it. Limits of HAA are those of ANYmal C in the
same package (-.72 to .49 rad); HFE and KFE turn freely there, and here as far as the boxes need,
knees inward. 80 Nm are that URDF's effort, 12 rad/s the speed of an ANYdrive (Hutter et al.,
ANYmal, 2016). Shapes are a box, cylinders and balls. A foot is a ball of .02 m, there of .031 m:
walks take feet for points, and a ball rolls while a leg turns over it. With .031 m the walk over
the cone slips 20.1 mm in MuJoCo, .1 mm more than a run lets pass. The trunk has what is left of the
mass, so that the robot weighs, and turns, as the YAML file says when its feet are where they stand
there.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tyro

from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.leg import Chain
from stancekit.planners.robot.walker import read_walker

ROBOTS = Path(__file__).resolve().parents[1] / "configs" / "robots"
COM_M = np.array([-0.001, -0.001, -0.021])
"""Of the standing robot in the base's frame: hips of the YAML file are HAA less this."""
RADIUS_M = 0.02
MASSES = {"HIP": 1.425, "THIGH": 1.635, "SHANK": 0.327, "FOOT": 0.02}
TORQUE_NM, SPEED_RAD_S = 80.0, 12.0
JOINTS = ("HAA", "HFE", "KFE")
AXES = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
RANGES = {"HAA": (-0.72, 0.49), "HFE": (-1.2, 1.9), "KFE": (-2.6, -0.1)}
"""Of the left fore leg [rad]; the others' are its mirror images."""


def leg_of(name: str) -> tuple[Array, Array, dict[str, tuple[float, float]]]:
    """Origins of joints and foot, each in the frame before it, shape (4, 3) [m]; side; limits by
    joint.
    """
    ahead, left = 1.0 if name[1] == "F" else -1.0, 1.0 if name[0] == "L" else -1.0
    side = np.array([ahead, left, 1.0])
    places = np.array(
        [[0.277, 0.116, 0.0], [0.0635, 0.041, 0.0], [0.0, 0.109, -0.25], [0.1, -0.02, -0.309]]
    )
    mirrored = {"HAA": left < 0.0, "HFE": ahead < 0.0, "KFE": ahead < 0.0}
    limits = {j: (-high, -low) if mirrored[j] else (low, high) for j, (low, high) in RANGES.items()}
    return places * side, side, limits


def chain_of(places: Array) -> Chain:
    """The same as forward kinematics has it."""
    return Chain(
        rotations=np.tile(np.eye(3), (3, 1, 1)),
        origins=places[:3],
        axes=AXES,
        slides=np.zeros(3, bool),
        tip_m=places[3],
    )


def posture(chain: Chain, foot_m: Array, start: Array) -> Array:
    """Newton's method from a posture near by, shape (3,) [rad]."""
    q = start
    for _ in range(50):
        at, slope = (part[0] for part in chain.feet_and_jacobian(q[None]))
        q = q + np.linalg.solve(slope, foot_m - at)
    assert np.linalg.norm(foot_m - chain.feet(q[None])[0]) < 1e-12
    return q


def rod(mass: float, along: Array, radius: float) -> Array:
    """A cylinder's inertia about its middle, its axis along a vector of its length [kg m²]."""
    length = float(np.linalg.norm(along))
    axis = along / length
    thin, flat = mass * radius**2 / 2.0, mass * (length**2 / 12.0 + radius**2 / 4.0)
    return flat * np.eye(3) + (thin - flat) * np.outer(axis, axis)


def numbers(values: Array, digits: int = 6) -> str:
    """Numbers in a row."""
    return " ".join(
        f"{value:.{digits}g}" for value in np.where(np.abs(values) < 1e-12, 0.0, values)
    )


def along(vector: Array) -> str:
    """Roll, pitch and yaw that turn z along a vector."""
    x, y, z = vector / np.linalg.norm(vector)
    return numbers(np.array([0.0, np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)]), 9)


def link(
    name: str, mass: float, middle: Array, inertia: Array, shape: str, at: str, digits: int = 6
) -> list[str]:
    """A link with one shape, which is seen and collides."""
    entries = zip(
        ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), inertia[np.triu_indices(3)], strict=True
    )
    said = " ".join(f'{key}="{value:.{digits}g}"' for key, value in entries)
    return [
        f'  <link name="{name}">',
        f'    <inertial><origin xyz="{numbers(middle, digits)}"/><mass value="{mass:.{digits}g}"/>',
        f"      <inertia {said}/></inertial>",
        f"    <visual><origin {at}/><geometry>{shape}</geometry></visual>",
        f"    <collision><origin {at}/><geometry>{shape}</geometry></collision>",
        "  </link>",
    ]


def main() -> None:
    """Write both files."""
    walker = read_walker(ROBOTS / "anymal.yaml")
    masses, middles, inertias = list[float](), list[Array](), list[Array]()
    lines, stands = list[str](), list[str]()
    for foot in walker.feet:
        places, side, limits = leg_of(foot.name)
        chain = chain_of(places)
        wanted = foot.nominal_m + COM_M + RADIUS_M * np.array([0.0, 0.0, 1.0])
        q = posture(chain, wanted, np.array([-0.1 * side[1], 0.7 * side[0], -1.0 * side[0]]))
        assert all(
            low < angle < high for angle, (low, high) in zip(q, limits.values(), strict=True)
        ), q
        turns, origins = (part[0] for part in chain.frames(q[None]))
        bodies = {
            "HIP": (places[1], 0.045),
            "THIGH": (places[2], 0.035),
            "SHANK": (places[3], 0.02),
        }
        for i, (part, (to, radius)) in enumerate(bodies.items()):
            mass, inertia = MASSES[part], rod(MASSES[part], to, radius)
            at = f'xyz="{numbers(0.5 * to)}" rpy="{along(to)}"'
            length = float(np.linalg.norm(to))
            shape = f'<cylinder radius="{radius:g}" length="{length:.6g}"/>'
            inertia = np.array([float(f"{value:.6g}") for value in inertia.ravel()]).reshape(3, 3)
            lines += link(f"{foot.name}_{part}", mass, 0.5 * to, inertia, shape, at)
            masses.append(mass)
            middles.append(origins[i] + turns[i] @ (0.5 * to))
            inertias.append(turns[i] @ inertia @ turns[i].T)
        ball = float(f"{0.4 * MASSES['FOOT'] * RADIUS_M**2:.6g}") * np.eye(3)
        lines += link(
            f"{foot.name}_FOOT",
            MASSES["FOOT"],
            np.zeros(3),
            ball,
            f'<sphere radius="{RADIUS_M}"/>',
            'xyz="0 0 0"',
        )
        masses.append(MASSES["FOOT"])
        middles.append(chain.feet(q[None])[0])
        inertias.append(ball)
        parts = ["base", *(f"{foot.name}_{part}" for part in MASSES)]
        for i, joint in enumerate(JOINTS):
            low, high = limits[joint]
            lines += [
                f'  <joint name="{foot.name}_{joint}" type="revolute">',
                f'    <parent link="{parts[i]}"/><child link="{parts[i + 1]}"/>',
                f'    <origin xyz="{numbers(places[i])}"/><axis xyz="{numbers(AXES[i])}"/>',
                f'    <limit lower="{low:g}" upper="{high:g}" effort="{TORQUE_NM:g}" velocity="{SPEED_RAD_S:g}"/>',
                "  </joint>",
            ]
            stands.append(f'    <joint name="{foot.name}_{joint}" value="{q[i]:.12g}"/>')
        lines += [
            f'  <joint name="{foot.name}_TOE" type="fixed">',
            f'    <parent link="{parts[3]}"/><child link="{parts[4]}"/><origin xyz="{numbers(places[3])}"/>',
            "  </joint>",
        ]
    mass = walker.mass_kg - sum(masses)
    middle = (
        walker.mass_kg * COM_M - sum(m * c for m, c in zip(masses, middles, strict=True))
    ) / mass
    inertia = walker.inertia_kgm2.copy()
    for m, c, own in zip(
        [*masses, mass], [*middles, middle], [*inertias, np.zeros((3, 3))], strict=True
    ):
        far = c - COM_M
        inertia -= own + m * (far @ far * np.eye(3) - np.outer(far, far))
    moments = np.linalg.eigvalsh(inertia)
    assert moments[0] > max(0.0, moments[2] - moments[1]), moments
    print(f"trunk {mass:.6g} kg at {numbers(middle)}, moments {numbers(moments)}")
    size = numbers(2.0 * walker.trunk_half_m)
    base = link(
        "base", mass, middle, inertia, f'<box size="{size}"/>', f'xyz="{numbers(COM_M)}"', digits=12
    )
    said = (__doc__ or "").split("\n\n", 2)
    first = "<!-- Legs for the boxes of anymal.yaml; benchmarks/anymal_urdf.py writes this file."
    head = f"{first}\n{said[2].strip()}\n-->"
    text = "\n".join(
        ['<?xml version="1.0"?>', head, '<robot name="anymal">', *base, *lines, "</robot>", ""]
    )
    (ROBOTS / "anymal.urdf").write_text(text, encoding="utf-8")
    state = [
        '<?xml version="1.0"?>',
        '<robot name="anymal">',
        '  <group_state name="standing" group="legs">',
        *stands,
    ]
    (ROBOTS / "anymal.srdf").write_text(
        "\n".join([*state, "  </group_state>", "</robot>", ""]), encoding="utf-8"
    )


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
