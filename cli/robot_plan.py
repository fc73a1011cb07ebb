"""What ``stancekit plan`` says of the whole body of a plan."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping


def bent_lines(details: Mapping[str, float]) -> Iterator[str]:
    """What planning with the whole body did to the largest torque and the deepest collision; nothing where it had
    nothing to do."""
    steps = int(details.get("torque_steps", 0.0))
    how = f"in {steps} step{'s' * (steps != 1)}" if steps else "by other forces"
    before, after = (details.get(name, math.nan) for name in ("torque_nm_before", "torque_nm"))
    if math.isfinite(after) and before != after:
        used = [details.get(f"torque_share{when}", math.nan) for when in ("_before", "")]
        why = f": of the joint nearest to its limit, {used[0]:.2f} → {used[1]:.2f} of it" if after > before else ""
        yield f"torque: {before:.1f} → {after:.1f} Nm {how}{why}"
    before, after = (1e3 * details.get(name, math.nan) for name in ("depth_m_before", "depth_m"))
    if math.isfinite(after) and before != after:
        yield f"deepest collision: {before:.1f} → {after:.1f} mm {how}"
