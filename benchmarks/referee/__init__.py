"""The referee: a small simulator that plays files of plans, walks and leaps and imports nothing of
the package that wrote them.

A file is read by its own keys. Robot and ground are built anew in MuJoCo: the robot from the URDF
inside the file, patches as prisms, heights as a field, feet as balls. Between key frames feet go
up, across and down, and load moves to those that stay, as this package has it; joints come from its
own inverse kinematics. They are controlled by position with feed-forward torque τ = bias − Jᵀ f of
the file's forces, with or without feedback of the body: a wrench that feet that stand share within
their cones, and feet in the air that go where a plan has them in the world. In a leap legs are
drawn up as its file says, and it is watched for two seconds after its end.
"""

from .files import BrokenFile, KeyFrames, read
from .settings import Push, Settings, Wrong, read_settings
from .simulation import Row, play, pushed

__all__ = [
    "BrokenFile",
    "KeyFrames",
    "Push",
    "Row",
    "Settings",
    "Wrong",
    "play",
    "pushed",
    "read",
    "read_settings",
]
