"""``stancekit emulate``: a device that is not there, for drivers and plans to be tried on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import tyro

from .emulate_rosbridge import EmulateRosbridge


@dataclass
class Emulate:
    """Emulate a device, to try a plan on before anything real: a robot behind a rosbridge.

    It begins where the plan does, with the robot at rest, and prints one JSON line that says where it is reached. Then
    it runs until Ctrl-C, SIGTERM, or the end of standard input where that is a pipe. A line on standard input is a
    fault to happen now, an empty one asks for the state; either is answered with the state, one JSON object per line.

      stancekit emulate rosbridge plan.json --port 9090
    """

    device: Annotated[
        Literal["rosbridge"], tyro.conf.Positional, tyro.conf.arg(metavar="rosbridge")
    ]
    """Kind of the device."""
    options: EmulateRosbridge

    def run(self) -> int:
        """Run the device until it is ended."""
        return self.options.run()
