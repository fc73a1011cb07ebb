"""Lines that ``stancekit plan`` prints about its planning with the whole body."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping


def bent_lines(details: Mapping[str, float]) -> Iterator[str]:
    """Lines on how planning with the whole body changed the largest torque and the deepest
    collision, and on what a larger torque is for; nothing where it had nothing to do.
    """
    steps = int(details.get("torque_steps", 0.0))
    how = f"in {steps} step{'s' * (steps != 1)}" if steps else "by other forces"
    torque, share, depth = (
        _change(details, name) for name in ("torque_nm", "torque_share", "depth_m")
    )
    if torque[0] != torque[1] and math.isfinite(torque[1]):
        why = ""
        if torque[1] > torque[0]:
            eased = (
                f"where the joint nearest to its limit needs {share[0]:.0%} → {share[1]:.0%} of it"
            )
            why = f", {eased}" if share[1] < share[0] else ", the price of bodies that keep apart"
        figures = [f"{each:.1f}" for each in torque]
        if figures[0] != figures[1]:
            yield f"torque: {figures[0]} → {figures[1]} Nm {how}{why}"
    if depth[0] != depth[1] and math.isfinite(depth[1]):
        yield f"deepest collision: {1e3 * depth[0]:.1f} → {1e3 * depth[1]:.1f} mm {how}"


def _change(details: Mapping[str, float], name: str) -> tuple[float, float]:
    """A figure before and after; nan where it is not known."""
    return details.get(f"{name}_before", math.nan), details.get(name, math.nan)
