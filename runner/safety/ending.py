"""End of a run: what state the robot is left in, and how long that took.

After a stop nothing moves any more: of the endings only hold and torque-off are left then, and home
becomes hold. Where an arming was interrupted, no torque is on that was off before, whatever was
asked for.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from stancekit.planners.errors import HardwareFault
from stancekit.planners.files.arrays import Array

from ..motion.time_parametrization import soft_motion
from .estop import Stopped
from .guard import SafeWorld

Ending = Literal["hold", "home", "torque-off"]
_Left = Literal["held", "home", "torque off", "left to the device", "as it was"]


@dataclass(frozen=True, kw_only=True)
class Ended:
    """End of a motion or of a stop.

    Arguments:
        left: the state in which the robot is.
        message: why it is another than was asked for, empty where it is not.
        seconds: from the stop, or from the end of the motion, until then.
    """

    left: _Left
    message: str
    seconds: float

    def to_json(self) -> dict[str, Any]:
        """JSON-ready."""
        return dict(self.__dict__)


def end(
    world: SafeWorld, ending: Ending, home: Sequence[Array] | None, speed_rad_s: float
) -> Ended:
    """Bring the robot into the state that was asked for; it never raises for what goes wrong on the
    way.

    Arguments:
        home: joint angles on the way there, home last, shape (J,) [rad] each, gone along at this
            speed; None where there is no path.
    """
    stopped = world.latch.tripped
    begin = world.latch.time_s if stopped else time.monotonic()
    left: _Left
    if world.dry:
        left, message = "as it was", "dry run: nothing was sent"
    elif ending == "torque-off":
        left, message = _relaxed(world)
    else:
        message = ""
        if ending == "home" and (stopped or home is None):
            message = (
                "home is not gone to after a stop" if stopped else "there is no clear way home"
            )
        elif ending == "home" and home is not None:
            message = _homeward(world, home, speed_rad_s)
        left, message = _held(world, message)
        if left == "held" and not world.armed:
            left, message = "as it was", "it was not armed"
        if ending == "home" and left == "held" and not message:
            left = "home"
    world.watchdog.rest()
    return Ended(left=left, message=message, seconds=time.monotonic() - begin)


def _homeward(world: SafeWorld, home: Sequence[Array], speed_rad_s: float) -> str:
    """Go home slowly; why not, where that was stopped."""
    try:
        for pose in home:
            for targets in soft_motion(world.last_rad, pose, speed_rad_s, world.rate_hz):
                world.step(targets)
    except (Stopped, HardwareFault) as error:
        return f"stopped on the way home: {error}"
    except Exception as error:  # whatever fails on the way home, the robot is to stop
        world.latch.trip(f"{type(error).__name__}: {error}")
        return f"stopped on the way home: {world.latch.reason}"
    return ""


def _held(world: SafeWorld, message: str) -> tuple[_Left, str]:
    wrong = _done(world.world.stop)
    if wrong:
        return "left to the device", f"{message}; {wrong}" if message else wrong
    return "held", message


def _relaxed(world: SafeWorld) -> tuple[_Left, str]:
    if not world.real:
        return "held", f"world {world.name} has no switch for its torque"
    wrong = _done(lambda: world.world.stop(torque_off=True))
    return ("left to the device", wrong) if wrong else ("torque off", "")


def _done(verb: Callable[[], str]) -> str:
    """Have a device do it, once more where that is cut off (by a second Ctrl-C); what went wrong,
    or may still move, empty if nothing.
    """
    wrong = ""
    for _ in range(2):
        try:
            return verb()
        except HardwareFault as error:
            return str(error)
        except BaseException as error:  # told as its outcome: nothing may end a stop
            wrong = f"{type(error).__name__}: {error}"
    return wrong
