"""``stancekit emulate bus``: servos on a pseudo-terminal, as a calibration file says, and their
faults.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from .options import OptionalPath, OptionalText


@dataclass
class EmulateBus:
    """Emulate the servos of a calibration file on a serial bus, which the real SDK of their maker
    talks to.

    Ids, model, baud rate and directions are those of the file, and its port becomes a link to the
    emulated one. Shafts stand as the plan begins, and carry nothing. Where this computer is too
    slow for them their time is slower, too, and the state says how much (time_share).
    """

    plan: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="PLAN")]
    """Plan file: the robot stands as it begins."""
    setup: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """Calibration file of its servos."""
    link: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """Link to make in place of the calibration file's port."""
    firmware: int = 45
    """Firmware of all servos: before 45 they have no Fast Sync Read, before 38 no bus watchdog."""
    fault: OptionalText = None
    """A fault to happen, by its name, e.g. "silent servo 4"; an unknown name is answered with all
    that there are."""
    at_s: float = 0.0
    """Seconds after the start at which it does."""
    seed: int = 0
    """Seed of what is drawn, e.g. of the servo that a fault hits where none is named."""

    def run(self) -> int:
        """Run until somebody ends it."""
        from stancekit.planners.errors import InvalidInput
        from stancekit.planners.files.arrays import checked, checked_int
        from stancekit.runner.emulators.servo_bus import EmulatedBus
        from stancekit.runner.emulators.start import start_of
        from stancekit.runner.worlds.dynamixel.calibration import Calibration

        from .converse import converse

        checked_int(self.firmware, "--firmware", least=1, most=255)
        checked(self.at_s, "--at-s", least=0.0)
        names, angles = start_of(self.plan)
        calibration = Calibration.from_yaml(self.setup, names)
        link = Path(calibration.port) if self.link is None else self.link
        if link.exists() and not link.is_symlink():
            raise InvalidInput(
                f"--link: expected a path at which a link can be made, got {link}, which is there"
            )
        servos = calibration.ordered(names)
        with EmulatedBus(
            [each.id for each in servos],
            calibration.shafts(names, angles).tolist(),
            model=calibration.kind.number,
            firmware=self.firmware,
            baud=calibration.baud,
            seed=self.seed,
        ) as bus:
            try:
                if self.fault is not None:
                    bus.inject(self.fault, self.at_s)
            except ValueError as error:
                raise InvalidInput(f"--fault: {error}") from None
            try:
                link.unlink(missing_ok=True)
                link.symlink_to(bus.path)
            except OSError as error:
                raise InvalidInput(f"--link: cannot make {link}: {error.strerror}") from None
            try:
                return converse({"port": str(link), "path": bus.path}, bus.inject, bus.state)
            finally:
                link.unlink(missing_ok=True)
