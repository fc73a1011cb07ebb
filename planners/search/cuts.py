"""Cuts in space: best-first branch and bound on candidates, pieces of patches and force boxes, for
any M ≥ 1, and the nogoods that it learns from stances that fail.

The lower bound is the lift with the least moment residual, the upper bound SCP from its toes. A
node confines footholds to some candidates, candidates to pieces of their patches, stance contacts
to boxes of forces; on a piece of no size the lift is exact, so bisection ends. A node whose moment
residual is proved above the gap is closed; when all are, the tree and the lift's multipliers are
the certificate. A posture problem is the case of one frame.

Copies of one hard stance over many frames multiply the tree, so the stances of a plan are tried
``alone`` first, each a relaxation of it (``Nogoods``).
"""

from __future__ import annotations

import heapq
import itertools
import math
import time
from dataclasses import dataclass, field, replace

import numpy as np

from ..answer.answer import Status
from ..answer.certificate import Certificate
from ..arguments import cached_property
from ..equilibrium.layout import Index
from ..equilibrium.programs import Programs, multiplier_shapes
from ..equilibrium.scaled import Point, Scaled, cones_met
from ..files.arrays import Array
from ..projection.project import SURFACE, scp
from ..relaxation.lift import LiftAnswer, solve_lift
from .answer import Clock

MARGIN = 1e-3
"""A bound above this, for multipliers of at most 1, is refused by no rounding and no tolerance of
the verifier."""


class FarkasCuts:
    """The cuts found so far on one problem. rows: multipliers, as a leaf of a certificate has
    them.
    """

    def __init__(self, scaled: Scaled) -> None:
        self._scaled = scaled
        self.rows: list[Array] = []
        self.constants = np.zeros(0)
        self.tables = np.zeros((0, scaled.layout.footholds, scaled.options))

    def add(self, row: Array) -> int:
        """Keep multipliers that refuted something; their number."""
        parts = split(self._scaled, row)
        self.rows.append(row)
        self.constants = np.append(self.constants, self._constant(parts))
        self.tables = np.concatenate([self.tables, self._table(parts)[None]])
        return len(self.rows) - 1

    def refuting(self, opened: Array) -> int | None:
        """A cut that refutes these open candidates, shape (P, options), or None."""
        if not self.rows:
            return None
        least = np.where(opened > 0.0, self.tables, np.inf).min(axis=2).sum(axis=1) + self.constants
        best = int(least.argmax())
        return best if least[best] > MARGIN else None

    def relief(self, choice: Index, opened: Array) -> Array:
        """Amounts by which other open candidates of every foothold would weaken the cuts that
        refute a choice, shape (P,).

        Each in shares of what it proves; zeros where none refutes the choice.
        """
        against = self.tables[:, np.arange(len(choice)), choice]
        proved = against.sum(axis=1) + self.constants
        refuting = proved > MARGIN
        best = np.where(opened > 0.0, self.tables[refuting], np.inf).min(axis=2)
        return np.asarray(((against[refuting] - best) / proved[refuting, None]).sum(axis=0))

    def _constant(self, parts: dict[str, Array]) -> float:
        """All of the bound but the toes."""
        scaled, layout, norm = self._scaled, self._scaled.layout, np.linalg.norm
        reach, nu_M = self._pulls(parts), parts["nu_M"]
        pull, twist = -reach.sum(axis=1), -np.cross(scaled.shoulders, reach).sum(axis=1)
        across = np.column_stack(
            [nu_M[:, 1], -nu_M[:, 0], 0.0 * nu_M[:, 0]]
        )  # −ν·(c × e_z) = (−e_z × ν)·c
        np.add.at(pull, layout.stance_frames, scaled.weight * across)
        pushed = 0.0
        if layout.loaded:
            np.add.at(pull, layout.stance_frames, np.cross(scaled.wrench[:, :3], nu_M))
            pushed = float(
                np.sum(parts["nu_F"] * scaled.wrench[:, :3] + nu_M * scaled.wrench[:, 3:])
            )
        step = parts["com_step"] - parts["progress"][:, None] * scaled.direction
        linear = np.matmul(parts["linear_step"][:, None], scaled.linear[..., :6])[:, 0]
        step, turn = step + linear[:, :3], parts["rotation_step"] + linear[:, 3:]
        for slope, change in ((pull, step), (twist, turn)):
            slope[1:] += change
            slope[:-1] -= change
        com_step, toe_step, rotation_step = scaled.steps
        return float(
            np.sum(pull * scaled.com)
            - scaled.weight * parts["nu_F"][:, 2].sum()
            + pushed
            - norm(pull, axis=1) @ scaled.com_radius
            - scaled.tilt * np.abs(twist).sum()
            - np.sum(parts["reach"] * scaled.shoulders)
            - norm(parts["reach"], axis=2).sum(axis=0) @ scaled.reach
            - parts["reach_rows"].sum(axis=0) @ scaled.half_spaces.outer_bounds
            - com_step * norm(parts["com_step"], axis=1).sum()
            - rotation_step * norm(parts["rotation_step"], axis=1).sum()
            - toe_step * norm(parts["toe_step"], axis=1).sum()
            - parts["relative_reach"] @ scaled.relative[layout.relative_rows[0], 3]
            + parts["progress"] @ scaled.progress
            - np.sum(parts["linear_step"] * scaled.linear[..., 6])
        )

    def _pulls(self, parts: dict[str, Array]) -> Array:
        """Pull of reach on every toe, its ball and its half-spaces, shape (M, N, 3)."""
        limbs = self._scaled.layout.row_limbs[:, None] == np.arange(self._scaled.layout.limbs)
        rows = (
            parts["reach_rows"][:, :, None, None]
            * limbs[:, :, None]
            * self._scaled.half_spaces.normals[:, None]
        )
        return np.asarray(parts["reach"] + rows.sum(axis=1))

    def _table(self, parts: dict[str, Array]) -> Array:
        """The least that a toe and the forces on it contribute, by foothold and candidate, shape
        (P, options).

        Of the force box only f_n counts here, which makes the bound weaker and never wrong.
        """
        scaled, layout = self._scaled, self._scaled.layout
        pull = np.zeros((layout.footholds, 3))
        np.add.at(pull, np.array(layout.holds).ravel(), self._pulls(parts).reshape(-1, 3))
        np.add.at(pull, layout.moves[:, 1], parts["toe_step"])
        np.add.at(pull, layout.moves[:, 0], -parts["toe_step"])
        row, which = layout.relative_rows
        apart = parts["relative_reach"][:, None] * scaled.relative[row, :3]
        np.add.at(pull, layout.relative_pairs[which, 1], apart)
        np.add.at(pull, layout.relative_pairs[which, 0], -apart)
        value = np.sum(scaled.vertices * pull[layout.vertex_footholds], axis=1)
        contact, vertex = layout.contact_vertices
        stance, candidate = layout.contacts[0][contact], layout.vertex_candidates[vertex]
        nu = parts["nu_F"][stance] + np.cross(
            parts["nu_M"][stance], scaled.bearing_vertices
        )  # ν·(v × F) = (ν × v)·F
        slope = np.matmul(nu[:, None], scaled.frames[candidate])[:, 0]
        along = slope[:, 0] - scaled.friction[candidate] * np.hypot(
            slope[:, 1], slope[:, 2]
        )  # of f_n, in the cone
        normal = np.stack(
            [np.maximum(scaled.force_min[contact, 0], 0.0), scaled.force_max[contact, 0]]
        )
        np.add.at(value, vertex, (along * normal).min(axis=0))
        ends = np.cumsum(np.bincount(layout.vertex_candidates))
        return scaled.by_candidate(np.minimum.reduceat(value, np.r_[0, ends[:-1]]), np.inf)


def of_stance(scaled: Scaled, stance: int, lift: LiftAnswer) -> Array:
    """A certificate's row with the multipliers of one stance alone (``cuts.alone``), and zeros for
    all others.
    """
    row = np.zeros(sum(int(np.prod(shape)) for shape in multiplier_shapes(scaled.layout).values()))
    whole, multipliers = split(scaled, row), split(lift.scaled, lift.multipliers)
    whole["nu_F"][stance], whole["nu_M"][stance] = multipliers["nu_F"][0], multipliers["nu_M"][0]
    frame = scaled.layout.stances[stance][0]
    whole["reach"][frame], whole["reach_rows"][frame] = (
        multipliers["reach"][0],
        multipliers["reach_rows"][0],
    )
    return row


def split(scaled: Scaled, row: Array) -> dict[str, Array]:
    """The groups of a certificate's row by name."""
    shapes = multiplier_shapes(scaled.layout)
    ends = np.cumsum([int(np.prod(shape)) for shape in shapes.values()])
    parts = np.split(row, ends[:-1])
    return {
        name: part.reshape(shape) for (name, shape), part in zip(shapes.items(), parts, strict=True)
    }


def halving_chord(piece: Array) -> tuple[float, float]:
    """Border coordinates of a chord that halves a polygon: a triangle's median to its longest edge,
    else a diagonal.
    """
    count = len(piece)
    if count > 3:
        return 0.0, float(count // 2)
    edge = int(np.argmax(np.linalg.norm(np.roll(piece, -1, axis=0) - piece, axis=1)))
    first, second = sorted((edge + 0.5, float((edge + 2) % 3)))
    return first, second


def cut(piece: Array, first: float, second: float) -> tuple[Array, Array]:
    """The two parts of a convex polygon on either side of a chord, as ``Certificate`` orders
    them.
    """
    count = len(piece)

    def point(coordinate: float) -> Array:
        edge, share = int(coordinate), coordinate - int(coordinate)
        return np.asarray(piece[edge] + share * (piece[(edge + 1) % count] - piece[edge]))

    def run(start: float, stop: float) -> Array:
        between = [piece[k % count] for k in range(int(start) + 1, int(np.ceil(stop)))]
        return np.array([point(start), *between, point(stop % count)])

    return run(first, second), run(second, first + count)


LEAF = (0.0, 0.0, 0.0, 0.0, 0.0)
_WHOLE = 1e-4
"""A share this close to 1 is a choice already made."""
PATCH_UNIT_M = 0.2
"""A force interval of half this many patch sizes is as wide as the patch: the rule of when to cut
the patch instead."""
_NEAR_ENDS = 0.1
"""A force interval is split where the lift has the force, but no nearer to an end than this share
of it."""
_FLAT = 0.1
"""Pieces of a patch may leave out so large a share of the gap; of a patch that is bent more, only
forces are split."""
_WORTH, _WORTH_LEAST = 3.0, 2e-3
"""Below the root, SCP steps on only where the first toes leave less than this many bounds, and
this, of moment."""
PROVABLE = None
"""As a gap: a node counts as refuted where the verifier can be expected to accept what its
multipliers prove."""
_WIDENED = 5e-6
"""Loss of a proof, a unit of its multipliers, since the verifier widens every constraint before it
counts."""
_STEPS = 4
"""Most linearised steps of SCP at a node."""
_BENEATH = 0.9
"""A point that leaves less than this share of the gap says that no proof will be accepted; of the
lift's bound at the root, in units of what a point may leave, ``_ABOVE`` says that no point will."""
_ABOVE = 20.0


@dataclass(kw_only=True, eq=False)
class Node:
    """A part of a problem, what the lift says there, and how it was split: a row of the
    certificate's tree.
    """

    scaled: Scaled
    lift: LiftAnswer
    row: tuple[float, ...] = LEAF
    children: list[Node] = field(default_factory=list)

    def rows(self) -> tuple[list[tuple[float, ...]], list[Array]]:
        """The certificate's rows from this node on, in preorder."""
        tree, multipliers = [self.row], [] if self.children else [self.lift.multipliers]
        for child in self.children:
            below, proofs = child.rows()
            tree += below
            multipliers += proofs
        return tree, multipliers


class CutSearch:
    """One search: for a point on the bilinear surface, or a proof that there is none.

    Arguments:
        gap: moment residual at which a node counts as refuted, or ``PROVABLE``.
        tolerance: violation that a point may have. max_nodes, deadline (``time.perf_counter()``),
            max_solves: where to stop.
        root: the lift of the problem, where it is solved already.
        wanted: of a search that counts only where it comes to this; it stops when it cannot any
            more. found: choice, (P,), and point; stopped: why there is neither.
    """

    def __init__(
        self,
        programs: Programs,
        scaled: Scaled,
        *,
        gap: float | None,
        tolerance: float,
        max_nodes: int,
        deadline: float,
        max_solves: float = math.inf,
        root: LiftAnswer | None = None,
        wanted: Status | None = None,
    ) -> None:
        self._programs, self._gap, self._wanted = programs, gap, wanted
        self._on_surface = max(SURFACE, 0.5 * tolerance)
        self._max_nodes, self._deadline, self._max_solves = max_nodes, deadline, max_solves
        self._whole = (
            scaled if scaled.weights is None else replace(scaled, weights=None)
        )  # it has no objective
        self.solves = self.nodes = 0
        self.seconds = 0.0
        self.stopped = ""
        self.found: tuple[Index, Point] | None = None
        self._least = float("inf")  # residual of a point
        self.root = self._node(self._whole, root)

    def run(self) -> None:
        """Search until there is a point, every node is refuted, or a limit."""
        order = itertools.count()
        queue = [(self._proved(self.root.lift), next(order), self.root)]
        while queue:
            bound, _, node = heapq.heappop(queue)
            if bound > (self._gap or 0.0):
                return  # best first: every open node is closed, too
            late = time.perf_counter() > self._deadline or self.solves >= self._max_solves
            if self.nodes > self._max_nodes or late or not node.lift.solved:
                self.stopped = "stopped at the time, node or solver limit"
                return
            if self._project(node) or self._in_vain(node):
                return
            node.row, parts = branch(node.scaled, node.lift, bent=self._bent)
            for child in [self._node(part) for part in parts]:
                node.children.append(child)
                heapq.heappush(queue, (self._proved(child.lift), next(order), child))

    @property
    def trivial(self) -> bool:
        """Tell whether not even P̄ has an answer, by the lift."""
        return bool(np.isinf(self.root.lift.bound))

    def certificate(self) -> Certificate | None:
        """The proof that there is no point, where every node was refuted."""
        if self.found is not None or self.stopped:
            return None
        tree, multipliers = self.root.rows()
        return Certificate(tree=np.array(tree), multipliers=np.array(multipliers))

    def _proved(self, lift: LiftAnswer) -> float:
        """The moment residual that counts: what the lift bounds, less what the verifier will take
        off.
        """
        if self._gap is not None or not np.isfinite(lift.bound):
            return lift.bound
        stances = len(lift.scaled.layout.stances)
        sizes = np.abs(lift.multipliers)
        return lift.bound - _WIDENED * float(
            sizes.sum() / max(sizes[3 * stances : 6 * stances].sum(), 1e-12)
        )

    def _node(self, scaled: Scaled, lift: LiftAnswer | None = None) -> Node:
        self.solves += 1
        self.nodes += 1
        lift = lift or solve_lift(self._programs, scaled, least_moment=True)
        self.seconds += lift.seconds
        return Node(scaled=scaled, lift=lift)

    def _project(self, node: Node) -> bool:
        """Look for a point from the node's toes.

        The whole problem's pieces and boxes hold, not only the node's.
        """
        choice, start = node.lift.rounded()
        worth, steps = (
            float("inf") if node is self.root else _WORTH * node.lift.bound + _WORTH_LEAST,
            _STEPS,
        )
        if self._wanted is Status.INFEASIBLE:  # a point only saves the rest of the search
            steps = _STEPS // 2 if node is self.root else 0
        point = scp(self._programs, self._whole.chosen(choice), start, steps=steps, worth=worth)
        self.solves += point.solves
        self.seconds += point.seconds
        self._least = min(self._least, point.residual)
        if point.residual <= self._on_surface:
            self.found = (choice, point)
        return self.found is not None

    def _in_vain(self, node: Node) -> bool:
        """Tell whether the wanted result cannot come any more: a bound lies above every point, or a
        point below all proofs.
        """
        beneath = self._gap is not None and self._least <= _BENEATH * self._gap
        above = node is self.root and node.lift.bound > _ABOVE * self._on_surface
        vain = (self._wanted is Status.INFEASIBLE and beneath) or (
            self._wanted is Status.FEASIBLE and above
        )
        if vain:
            self.stopped = f"{self._wanted} is out of the question"
        return vain

    @cached_property
    def _bent(self) -> Array:
        return bent_patches(self._whole, _FLAT * (self._gap or _WIDENED))


def bent_patches(scaled: Scaled, most: float) -> Array:
    """1 where the pieces of a whole patch do not cover it to ``most``: what they leave out is taken
    off every bound.

    Shape (P, options).
    """
    bends = np.array([_bend(piece) for piece in scaled.pieces])
    return np.asarray(scaled.by_candidate(bends, 0.0) > most, dtype=np.float64)


def branch(
    scaled: Scaled, lift: LiftAnswer, contact: int | None = None, bent: Array | None = None
) -> tuple[tuple[float, ...], list[Scaled]]:
    """A row of a certificate's tree that splits a problem where its lift is loose, and the two
    parts, which cover it.

    First a foothold torn between candidates; then the force box of the stance contact and component
    whose f_u / λ_u differ most, at the force that the lift has there, or, where what the cones
    leave of the box is narrower than its patch, the patch.

    Arguments:
        contact: where another one is wanted.
        bent: of which patches only the forces may be split, (P, options).
    """
    torn = _torn(scaled, lift)
    if torn is not None:
        p, r = torn
        on, off = scaled.opened(), scaled.opened()
        on[p], off[p, r] = 0.0, 0.0
        on[p, r] = 1.0
        return (1.0, float(p), float(r), 0.0, 0.0), [scaled.only(on), scaled.only(off)]
    spread = spreads(lift)
    contact = int(spread.max(axis=1).argmax()) if contact is None else contact
    axis = int(spread[contact].argmax())
    foothold = int(scaled.layout.contacts[2][contact])
    candidates = np.flatnonzero(scaled.layout.candidate_footholds == foothold)
    candidate = int(candidates[lift.shares[candidates].argmax()])
    piece, number = scaled.pieces[candidate], int(scaled.numbers[candidate])
    low, high = scaled.force_min.copy(), scaled.force_max.copy()
    grip = scaled.by_candidate(scaled.friction, 0.0).max(axis=1)[scaled.layout.contacts[2]]
    least, most = (float(end[contact, axis]) for end in cones_met(low, high, grip))
    width = most - least
    size = float(np.max(np.linalg.norm(piece[:, None] - piece[None], axis=-1))) * scaled.length_m
    small = spread[contact, axis] < 1e-9 or width < 0.5 * size / PATCH_UNIT_M
    if small and len(piece) > 2 and not (bent is not None and bent[foothold, number]):
        first, second = halving_chord(piece)
        row = (2.0, float(foothold), float(number), first, second)
        return row, [scaled.with_piece(candidate, part) for part in cut(piece, first, second)]
    force = float(lift.by_vertex[scaled.layout.contact_vertices[0] == contact, axis].sum())
    room = _NEAR_ENDS * width
    value = min(max(force, least + room), most - room) if width > 0.0 else 0.5 * (least + most)
    value = min(max(value, float(low[contact, axis])), float(high[contact, axis]))
    below, above = high.copy(), low.copy()
    below[contact, axis] = above[contact, axis] = value
    parts = [scaled.with_force_box(low, below), scaled.with_force_box(above, high)]
    return (3.0, float(contact), float(axis), value, 0.0), parts


def _bend(border: Array) -> float:
    """Distance of the corners of a patch from each other along its normal; 0 for a triangle."""
    if len(border) <= 3:
        return 0.0
    away = border - border.mean(axis=0)
    return float(np.ptp(away @ np.linalg.svd(away)[2][2]))


def _torn(scaled: Scaled, lift: LiftAnswer) -> tuple[int, int] | None:
    """The foothold that is least decided between its candidates, and the best of these; None where
    all are.
    """
    if all(len(counts) == 1 for counts in scaled.layout.corners):
        return None
    shares = scaled.by_candidate(lift.shares, 0.0)
    open_ = np.where(scaled.opened().sum(axis=1) > 1.0, 1.0 - shares.max(axis=1), -1.0)
    p = int(open_.argmax())
    return (p, int(shares[p].argmax())) if open_[p] > _WHOLE else None


def alone(scaled: Scaled, stance: int) -> tuple[Scaled, Index, Index]:
    """One stance as a problem of one frame, with its footholds and the rows of its contacts in the
    whole one.

    Every plan holds an answer of it: limbs that do not carry are in reach of their footholds, too.
    """
    layout = scaled.layout
    frame, limbs = layout.stances[stance]
    footholds = np.array(layout.holds[frame], dtype=np.int_)
    contacts = np.flatnonzero(layout.contacts[0] == stance)
    candidates = np.concatenate(
        [np.flatnonzero(layout.candidate_footholds == p) for p in footholds]
    )
    vertices = np.concatenate([np.flatnonzero(layout.vertex_footholds == p) for p in footholds])
    part = replace(
        scaled,
        layout=replace(
            layout,
            holds=(tuple(range(layout.limbs)),),
            stances=((0, limbs),),
            pushes=0,
            stands=False,
            wrench=layout.wrench,
            corners=tuple(layout.corners[p] for p in footholds),
        ),
        which=tuple(scaled.which[p] for p in footholds),
        vertices=scaled.vertices[vertices],
        frames=scaled.frames[candidates],
        friction=scaled.friction[candidates],
        offsets=scaled.offsets[candidates] if layout.points else scaled.offsets,
        force_min=scaled.force_min[contacts],
        force_max=scaled.force_max[contacts],
        com=scaled.com[[frame]],
        com_radius=scaled.com_radius[[frame]],
        direction=np.zeros((0, 3)),
        progress=np.zeros(0),
        standing=np.zeros((0, 3)),
        wrench=scaled.wrench[[stance % layout.unpushed]] if layout.wrench else np.zeros((0, 6)),
    )
    return part, footholds, contacts


def spreads(lift: LiftAnswer) -> Array:
    """Spread of f_u / λ_u over the vertices under each stance contact, by component, weighted by λ;
    (B, 3).
    """
    contact, vertex = lift.scaled.layout.contact_vertices
    starts = np.searchsorted(contact, np.arange(len(lift.scaled.force_min)))
    share = lift.weights[vertex][:, None]
    mean = np.add.reduceat(lift.by_vertex, starts)
    away = lift.by_vertex / np.maximum(share, 1e-9) - mean[contact]
    return np.asarray(np.sqrt(np.add.reduceat(share * away**2, starts)))


NODES = 120
"""Most nodes of the search whether a stance can be held."""
_WIDER_LEAST = 8
"""A widened one may take the nodes that it took before times the most candidates of a limb let in,
and so many more."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Nogood:
    """Candidates of a stance's footholds none of which can hold it: refuted, (P, options), 1 also
    elsewhere.

    Arguments:
        root: of the search that says so, over those candidates alone.
    """

    stance: int
    refuted: Array
    root: Node


class Nogoods:
    """The nogoods found so far on one problem: sets of candidates under one stance that were refuted
    by cuts in space, and so close every part within them.

    P1 may admit a choice of patches of which one stance alone cannot be held: its lift is not tight
    there. Cuts in space refute such a stance in a few small programs of one frame; the refuted
    choice is then widened, limb by limb, to all candidates for which it stands. A nogood closes
    nodes of the search over choices, guides its dive, and stands in the certificate as the subtree
    that proves it.
    """

    def __init__(self, programs: Programs, scaled: Scaled, clock: Clock) -> None:
        self._programs, self._scaled, self._clock = programs, scaled, clock
        self._known: set[tuple[int, ...]] = set()
        self.entries: list[_Nogood] = []
        self.masks = np.zeros((0, scaled.layout.footholds, scaled.options))

    def refuting(self, opened: Array) -> int | None:
        """A nogood that covers these open candidates, shape (P, options), or None."""
        if not self.entries:
            return None
        covers = np.all(self.masks >= (opened > 0.0), axis=(1, 2))
        return int(covers.argmax()) if covers.any() else None

    def learn(self, choice: Index, share: float) -> bool:
        """Look at every stance alone on this choice, (P,); whether one is refuted.

        Arguments:
            share: of the clock's limits, where to stop.
        """
        layout, chosen = self._scaled.layout, self._scaled.chosen(choice)
        learned = False
        for stance, (frame, _) in enumerate(layout.stances):
            under = [layout.holds[frame][limb] for limb in range(layout.limbs)]
            key = (stance, *(int(choice[p]) for p in under))
            if key in self._known:
                continue
            if self._clock.ended(share):
                break
            self._known.add(key)
            root = self._refuted(chosen, stance, NODES, share)
            if root is None:
                continue
            learned = True
            self.entries.append(self._widened(stance, choice, root, share))
            self.masks = np.concatenate([self.masks, self.entries[-1].refuted[None]])
        return learned

    def covering(self, choice: Index, foothold: int) -> Array:
        """Number of nogoods that a choice, (P,), meets with each candidate of one foothold, shape
        (options,).
        """
        inside = self.masks[:, np.arange(len(choice)), choice] > 0.0
        inside[:, foothold] = True
        return np.asarray(self.masks[inside.all(axis=1), foothold].sum(axis=0))

    def blame(self, number: int, opened: Array) -> int | None:
        """A foothold whose open candidates a nogood does not cover, and which has several; None
        without one.
        """
        loose = np.any((opened > 0.0) & (self.masks[number] <= 0.0), axis=1) & (
            opened.sum(axis=1) > 1.0
        )
        return int(loose.argmax()) if loose.any() else None

    def rows(self, number: int, opened: Array) -> tuple[list[tuple[float, ...]], list[Array]]:
        """The subtree of a certificate that proves a nogood at a leaf with these open candidates,
        in preorder.
        """
        entry = self.entries[number]
        _, footholds, contacts = alone(self._scaled, entry.stance)
        tree, multipliers = list[tuple[float, ...]](), list[Array]()

        def walk(node: Node, left: Array) -> None:
            kind, i, j, first, second = node.row
            if kind == 0.0:
                tree.append(node.row)
                multipliers.append(of_stance(self._scaled, entry.stance, node.lift))
                return
            p, r = int(i), int(j)
            if (
                kind in (1.0, 2.0) and left[p, r] <= 0.0
            ):  # nothing of it is here: one child covers the rest
                walk(node.children[1 if kind == 1.0 else 0], left)
            elif kind == 1.0 and left[p].sum() == 1.0:
                walk(node.children[0], left)
            else:
                number = contacts[p] if kind == 3.0 else footholds[p]
                tree.append((kind, float(number), j, first, second))
                on, off = left.copy(), left.copy()
                if kind == 1.0:
                    on[p], off[p, r] = 0.0, 0.0
                    on[p, r] = 1.0
                for child, some in zip(node.children, (on, off), strict=True):
                    walk(child, some)

        walk(entry.root, opened[footholds])
        return tree, multipliers

    def _widened(self, stance: int, choice: Index, root: Node, share: float) -> _Nogood:
        """The refuted choice with every limb's other candidates in, as far as the stance stays
        refuted.
        """
        scaled, layout = self._scaled, self._scaled.layout
        frame, limbs = layout.stances[stance]
        everything, mask = scaled.opened(), np.ones((layout.footholds, scaled.options))
        under = np.array(layout.holds[frame])
        mask[under] = np.eye(scaled.options)[choice[under]]
        idle = [layout.holds[frame][limb] for limb in range(layout.limbs) if limb not in limbs]
        for group in (idle, *([layout.holds[frame][limb]] for limb in limbs)):
            if everything[group].sum() <= len(group) or self._clock.ended(share):
                continue
            wider = mask.copy()
            wider[group] = 1.0
            nodes = int(everything[group].sum(axis=1).max()) * len(root.rows()[0]) + _WIDER_LEAST
            nogood = self._refuted(scaled.only(everything * wider), stance, nodes, share)
            if nogood is not None:
                mask, root = wider, nogood
        return _Nogood(stance=stance, refuted=mask, root=root)

    def _refuted(self, scaled: Scaled, stance: int, nodes: int, share: float) -> Node | None:
        """The root of a search that refutes the stance alone; None where it does not, or not in
        time.
        """
        left_s, solves = self._clock.left(share)
        search = CutSearch(
            self._programs,
            alone(scaled, stance)[0],
            gap=PROVABLE,
            tolerance=0.0,
            max_nodes=nodes,
            deadline=time.perf_counter() + left_s,
            max_solves=solves,
        )
        search.run()
        self._clock.count(search.solves, search.seconds)
        return None if search.found is not None or search.stopped else search.root
