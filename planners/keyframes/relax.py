"""P1 over key frames: m = p f of every bearing replaced by the McCormick envelope over its box (paper E §III, §IV-B).

The hard form minimises the course's objective over the envelopes. The soft form is the signed margin of
``contact.relax`` for a whole course: minimise t with every envelope row relaxed by t; the hard form is feasible iff t
is not positive. Several boxes a stance make a choice, one z a stance and box by hull disjunction: ``ModedCourse``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cvxpy as cp
import numpy as np

from ..arrays import Array
from ..conic import ConicModel, ConicSolution, ConicStatus
from ..contact.relax import FEASIBLE_MARGIN, box_values, mccormick_rows
from ..relaxation.envelope import Envelope
from ..scene.course import Weights
from .layout import Index, Layout, one_hot
from .products import Axes, Products, box_frames, domain_of, product_values, turned
from .scaled import ScaledCourse
from .terms import objective


@dataclass(frozen=True, kw_only=True, eq=False)
class EnvelopedPlan:
    """One solve of P1 over envelopes.

    margin: t of the soft form; of the hard one 0 where it has an answer, inf where it has none. NaN where the solver
    gave up. shares: of every slot, (P, R). toes: by slot, (P, R, 3). forces: contact frames, (B, 3). gap: largest
    |m − p f|. modes: z of every stance and box, shape (S, E).
    """

    status: ConicStatus
    solution: ConicSolution
    objective: float
    margin: float
    com: Array
    rotation: Array
    shares: Array
    toes: Array
    forces: Array
    gap: float
    modes: Array

    @property
    def feasible(self) -> bool:
        """Whether P1 admits the course. False also where nothing is known."""
        return self.margin <= FEASIBLE_MARGIN

    def rounded(self) -> tuple[Index, Array]:
        """The candidate of the largest share for every placement, and the toe on it; shapes (P,), (P, 3)."""
        choice = np.asarray(self.shares.argmax(axis=1), dtype=np.int_)
        return choice, self.toes[np.arange(len(choice)), choice]


class EnvelopedCourse:
    """P1 over one box a bearing, for one layout, compiled."""

    def __init__(
        self, layout: Layout, weights: Weights, typical: ScaledCourse, *, soft: bool = False, axes: Axes = "contact"
    ) -> None:
        terms = Products(layout, axes)
        margin = cp.Variable(name="margin") if soft else 0.0
        rows = mccormick_rows(terms.position, terms.box_forces, terms.moments, margin)
        length_m = typical.course.length_scale_m
        cost = margin if soft else objective(layout, weights, length_m, terms.body, terms.on_toes)
        self._layout, self._axes, self._soft = layout, axes, soft
        values = product_values(typical, box_frames(typical, axes)) | box_values(_room(typical, axes))
        self._model = ConicModel(cp.Problem(cp.Minimize(cost), [*terms.constraints, *rows]), equilibrate=values)

    @property
    def model(self) -> ConicModel:
        """The compiled model."""
        return self._model

    def solve(self, scaled: ScaledCourse, box: Envelope, *, modes: Array | None = None) -> EnvelopedPlan:
        """Solve P1 for a course of this layout. box: over its B bearings (``boxes.boxes_of``).

        modes: of which mode every stance's part of the box is, for the record, shape (S, E).
        """
        solution = self._model.solve(product_values(scaled, box_frames(scaled, self._axes)) | box_values(box))
        modes = np.ones((len(self._layout.stances), 1)) if modes is None else modes
        solved = solution.status is ConicStatus.SOLVED
        margin = float(self._model.value("margin", solution)) if solved and self._soft else 0.0
        return enveloped_plan(self._model, solution, scaled, self._axes, modes=modes, margin=margin)


class ModedCourse:
    """P1 over E boxes a bearing, one of them chosen a stance: the convex hull of the choices, with bounds on them.

    Each stance has z_e ≥ 0, Σ z = 1, and its (p, f, m) is a sum of copies, the e-th in z_e times the envelope of box e.
    """

    def __init__(
        self, layout: Layout, weights: Weights, typical: ScaledCourse, *, boxes: int, axes: Axes = "world"
    ) -> None:
        terms, stances = Products(layout, axes), len(layout.stances)
        modes = cp.Variable((stances, boxes), name="modes", nonneg=True)
        allowed = cp.Parameter((stances, boxes), name="allowed", nonneg=True)
        bearings = len(layout.bearing[0])
        of_stance = one_hot(layout.bearing[0], stances)
        copies = [[cp.Variable((bearings, width)) for width in (3, 3, 9)] for _ in range(boxes)]
        rows = [
            row for e, (p, f, m) in enumerate(copies) for row in shared_rows(p, f, m, of_stance @ modes[:, e], f"_{e}")
        ]
        whole = (terms.position, terms.box_forces, terms.moments)
        sums = [variable == sum(parts) for variable, parts in zip(whole, zip(*copies, strict=True), strict=True)]
        cost = objective(layout, weights, typical.course.length_scale_m, terms.body, terms.on_toes)
        constraints = [*terms.constraints, *rows, *sums, cp.sum(modes, axis=1) == 1, modes <= allowed]
        self._layout, self._axes, self._boxes = layout, axes, boxes
        room = [_room(typical, axes)] * boxes
        self._model = ConicModel(
            cp.Problem(cp.Minimize(cost), constraints),
            equilibrate=self._values(typical, room, np.ones((stances, boxes))),
        )

    @property
    def model(self) -> ConicModel:
        """The compiled model."""
        return self._model

    def solve(self, scaled: ScaledCourse, boxes: Sequence[Envelope], allowed: Array) -> EnvelopedPlan:
        """Solve the hull. allowed: 1 where a stance may use a box, 0 where not, shape (S, E)."""
        solution = self._model.solve(self._values(scaled, boxes, allowed))
        solved = solution.status is ConicStatus.SOLVED
        modes = np.clip(self._model.value("modes", solution), 0.0, 1.0) if solved else allowed
        return enveloped_plan(self._model, solution, scaled, self._axes, modes=modes)

    def _values(self, scaled: ScaledCourse, boxes: Sequence[Envelope], allowed: Array) -> dict[str, Array | float]:
        values = product_values(scaled, box_frames(scaled, self._axes)) | {"allowed": allowed}
        for e, box in enumerate(boxes):
            values |= {f"{name}_{e}": value for name, value in box_values(box).items()}
        return values


def shared_rows(
    position: cp.Expression, forces: cp.Expression, moments: cp.Expression, share: cp.Expression, name: str
) -> list[cp.Constraint]:
    """(p, f, m) ∈ z M_c(B): the rows of ``mccormick_rows`` made homogeneous by the share z of each bearing.

    share: shape (B,). The parameters are those of ``box_values``, their names followed by ``name``.
    """
    count, three = position.shape[0], np.ones((1, 3))
    p_low, p_high, f_low, f_high = (
        cp.Parameter((count, 3), name=key + name) for key in ("p_low", "p_high", "f_low", "f_high")
    )
    ends = ("low_low", "high_high", "low_high", "high_low")  # of p and of f
    both = [cp.Parameter((count, 9), name=key + name) for key in ends]
    rows, columns = np.kron(np.eye(3), three), np.kron(three, np.eye(3))  # p_j and f_k over the columns 3j + k
    column = cp.reshape(share, (count, 1), order="C")
    z3, z9 = column @ three, column @ np.ones((1, 9))
    p, f = position @ rows, forces @ columns
    pairs = ((p_low, f_low), (p_high, f_high), (p_low, f_high), (p_high, f_low))
    bilinear = [
        cp.multiply(p_end @ rows, f) + cp.multiply(f_end @ columns, p) - cp.multiply(product, z9)
        for (p_end, f_end), product in zip(pairs, both, strict=True)
    ]
    return [
        bilinear[0] <= moments, bilinear[1] <= moments, moments <= bilinear[2], moments <= bilinear[3],
        cp.multiply(p_low, z3) <= position, position <= cp.multiply(p_high, z3),
        cp.multiply(f_low, z3) <= forces, forces <= cp.multiply(f_high, z3),
    ]  # fmt: skip


def enveloped_plan(
    model: ConicModel, solution: ConicSolution, scaled: ScaledCourse, axes: Axes, *, modes: Array, margin: float = 0.0
) -> EnvelopedPlan:
    """Read an answer of either model."""
    layout, status = scaled.layout, solution.status
    solved = status is ConicStatus.SOLVED
    shape = (layout.placements, layout.regions)
    weights = np.maximum(model.value("weights", solution), 0.0) if solved else np.ones((layout.slots, 1))
    shares = weights.sum(axis=1)
    by_slot = np.matmul(weights[:, None, :], scaled.vertices)[:, 0] if solved else np.zeros((layout.slots, 3))
    pieces = model.value("forces", solution)
    box_forces = model.value("box_forces", solution) if turned(layout, axes) else pieces
    product = model.value("position", solution)[:, :, None] * box_forces[:, None, :]
    without = float("inf") if status is ConicStatus.INFEASIBLE else float("nan")
    return EnvelopedPlan(
        status=status,
        solution=solution,
        objective=solution.objective,
        margin=margin if solved else without,
        com=model.value("com", solution),
        rotation=model.value("rotation", solution),
        shares=shares.reshape(shape),
        toes=(by_slot / np.maximum(shares, 1e-12)[:, None]).reshape(*shape, 3),
        forces=pieces.reshape(-1, layout.regions, 3).sum(axis=1),
        gap=float(np.abs(model.value("moments", solution) - product.reshape(-1, 9)).max()) if solved else float("nan"),
        modes=modes,
    )


def _room(scaled: ScaledCourse, axes: Axes) -> Envelope:
    """A box with room for the course, for the solver's scaling."""
    return domain_of(scaled, axes).widened(0.1)
