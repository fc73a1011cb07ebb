"""McCormick's envelope of m = p f over a box, as rows of a conic program (Lin et al. §III)."""

from __future__ import annotations

from typing import Any

from ..equilibrium.layout import Index, Of
from ..equilibrium.rows import Rows
from .envelope import Corners


def envelope_rows(
    rows: Rows[Any],
    whole: Index,
    moments: Index,
    *,
    margin: Index | None = None,
    share: Index | None = None,
    e: int | None = None,
) -> None:
    """(p, f, m) ∈ M_c(B): the four envelope rows of every m_jk = p_j f_k, and [p, f] ∈ B, the e-th
    box.

    Arguments:
        whole: [p, f], (B, 6).
        moments: (B, 9).
        margin: relaxes every row.
        share: z of every contact, (B,), in whose measure the rows are: (p, f, m) ∈ z M_c(B).
    """
    count = len(whole)
    envelope, sides = (
        rows.at_most(_of("envelope", e), 4, count, 3, 3),
        rows.at_most(_of("sides", e), 2, count, 6),
    )
    rows.put(envelope[:2], moments.reshape(-1, 3, 3), -1.0)
    rows.put(envelope[2:], moments.reshape(-1, 3, 3), 1.0)
    p_ends, f_ends, products, outward = (Of(f"corners.{name}", e) for name in Corners._fields)
    rows.put(envelope, whole[:, None, 3:], p_ends)
    rows.put(envelope, whole[:, :3, None], f_ends)
    rows.put(sides[0], whole, -1.0)
    rows.put(sides[1], whole, 1.0)
    for group, bounds, at in (
        (envelope, products, (slice(None), None, None)),
        (sides, outward, (slice(None), None)),
    ):
        if share is not None:
            rows.put(group, share[at], -bounds)
            continue
        rows.right(group, bounds)
        if margin is not None:
            rows.put(group, margin, -1.0)


def _of(name: str, e: int | None) -> str:
    return name if e is None else f"{name}_{e}"
