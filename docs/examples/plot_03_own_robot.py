"""A robot of your own
===================

A quadruped written as a URDF; Stancekit finds legs, feet and joints by their shape and names, and
plans for it.
"""

from pathlib import Path

import stancekit


def part(name: str, mass: float, shape: str, xyz: str = "0 0 0") -> str:
    """A link."""
    i = mass * 0.01
    return (
        f'<link name="{name}"><inertial><origin xyz="{xyz}"/><mass value="{mass}"/>'
        f'<inertia ixx="{i}" ixy="0" ixz="0" iyy="{i}" iyz="0" izz="{i}"/></inertial>'
        f'<collision><origin xyz="{xyz}"/><geometry>{shape}</geometry></collision></link>'
    )


def joint(name: str, kind: str, parent: str, child: str, xyz: str, further: str = "") -> str:
    """A joint between two links."""
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{further}</joint>'


def turns(axis: str, low: float, high: float) -> str:
    """Axis and limits of a joint of 40 Nm."""
    return f'<axis xyz="{axis}"/><limit lower="{low}" upper="{high}" effort="40" velocity="10"/>'


def leg(n: str, x: float, y: float) -> str:
    """Hip, thigh and shank of 25 cm, a ball for a foot."""
    out, bone = 0.06 if y > 0 else -0.06, '<cylinder radius="0.02" length="0.19"/>'
    aside, ahead, bend = (("1 0 0", -0.7, 0.7), ("0 1 0", -1.2, 1.6), ("0 1 0", -2.4, -0.3))
    text = part(f"{n}_hip", 0.5, '<sphere radius="0.035"/>')
    text += part(f"{n}_thigh", 0.8, bone, "0 0 -0.125")
    text += part(f"{n}_shank", 0.3, bone, "0 0 -0.125")
    text += part(f"{n}_foot", 0.05, '<sphere radius="0.02"/>')
    text += joint(f"{n}_abduct", "revolute", "trunk", f"{n}_hip", f"{x} {y} 0", turns(*aside))
    text += joint(f"{n}_swing", "revolute", f"{n}_hip", f"{n}_thigh", f"0 {out} 0", turns(*ahead))
    text += joint(f"{n}_knee", "revolute", f"{n}_thigh", f"{n}_shank", "0 0 -0.25", turns(*bend))
    return text + joint(f"{n}_ankle", "fixed", f"{n}_shank", f"{n}_foot", "0 0 -0.25")


places = {"LF": (0.22, 0.08), "RF": (0.22, -0.08), "LH": (-0.22, 0.08), "RH": (-0.22, -0.08)}
trunk = part("trunk", 8.0, '<box size="0.4 0.14 0.08"/>')
legs = "".join(leg(name, *place) for name, place in places.items())
_ = Path("dog.urdf").write_text(f'<robot name="dog">{trunk}{legs}</robot>')

# %%
ends = {"start": (0, 0), "goal": (0.2, 0)}
answer = stancekit.plan("rubble:0.1:1", **ends, robot="dog.urdf", time_limit_s=120)
print(answer.status.value, answer.report.message)
_ = stancekit.draw(answer.solution, caption="a robot of a file", out="dog.png")
