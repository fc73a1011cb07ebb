"""Independent check of infeasibility certificates of posture problems and courses: matrix-vector
work, no solver.

A certificate is a tree that covers all choices of patches, toes and forces, and multipliers a leaf
(``answer.certificate.Certificate``). The tree is replayed from the problem's own patches and force boxes
(``Forest``), and every leaf's bound is worked out anew (``lagrangian``), so nothing in a certificate
has to be trusted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TypeVar

import numpy as np

from ..answer.certificate import Certificate
from ..answer.report import Group, Report
from ..errors import InvalidInput, require
from ..files.arrays import Array
from ..problem import Problem
from ..problem.contact import half_space, parts, too_small
from ..problem.leap import Leap
from ..problem.passage import Passage
from .geometry import (
    contact_frames,
    counts_of,
    cut,
    relative_rows,
    row_counts,
    sag,
    scaled_half_spaces,
    sole_points,
)
from .lagrangian import Leaves, Numbers, leaf_bounds, multiplier_count
from .stances import Index, Schedule, wrenches

_Side = Array | None
"""Corners of a side of a least step; None where it is open."""
_Node = tuple[Index, Array, Array, tuple[_Side, ...]]
"""The piece that each candidate still has, the force boxes, and the side of each least step."""
_Replayed = tuple[list[_Node], Array]
"""The leaves in preorder and their multipliers."""
Node = TypeVar("Node")
_MOST_CORNERS = 1_000_000
"""Most corners of all pieces that a tree cuts, each of which takes about a kilobyte to bound."""
_DEEPEST = 200
"""Cuts that a piece may come from: each moves its border by a rounding, and so many stay far below
the guard."""


class Forest:
    """Problems of one schedule in non-dimensional numbers, and the pieces of their patches as trees
    cut them.

    Piece T q + t, for problem q and candidate t of T, is the whole patch; cuts add more.
    """

    def __init__(self, numbers: Numbers, patches: list[Array], least: Array, sides: Array) -> None:
        self.numbers = numbers
        self._least, self._open = least, sides  # δ, (E,); rows where a side is open, (E, 4)
        self._count = multiplier_count(numbers.schedule)
        self._pieces = patches  # (U, 3) each, Q·T to begin with
        self._whole = len(patches)  # so many pieces are whole patches
        self._roots = list(range(len(patches)))  # the whole patch of every piece
        self._depths = [0] * len(patches)  # how many cuts every piece comes from
        self._corners = 0  # of all pieces that are not whole

    @staticmethod
    def of_course(course: Problem) -> Forest:
        """A course: a candidate is a candidate patch of a foothold, a toe that already stands a
        patch of one point.
        """
        length, limbs = course.unit_m, course.robot.limbs
        who = Schedule.of_course(course)
        patches = [patch for foothold in course.footholds for patch in foothold.candidates]
        stands = [foothold.toe_m for foothold in course.footholds for _ in foothold.candidates]
        regions = [region for row in course.regions for region in row]
        points = [
            region.vertices_m if toe is None else toe[None]
            for region, toe in zip(regions, stands, strict=True)
        ]
        axes = np.array([(patch.normal, patch.shear_reference) for patch in patches])
        ahead = np.array([course.direction(k) for k in range(1, course.frames)]).reshape(-1, 3)
        every, steps, apart = (
            (1, len(who.stance), 3),
            course.steps,
            relative_rows(course.robot, who.holds),
        )
        low, high = course.force_bounds
        toe_sides, turn_sides = (np.array(rows) for rows in course.side_rows)
        toe_sides[:, 3] /= length
        least = course.least_steps if course.sides is None else np.zeros(0)
        least[: len(toe_sides)] /= length
        numbers = Numbers(
            schedule=who,
            candidate=np.repeat(
                np.arange(len(course.footholds)),
                [len(foothold.candidates) for foothold in course.footholds],
            ),
            frames=contact_frames(axes[:, 0], axes[:, 1])[None],
            friction=np.array([[patch.friction for patch in patches]]),
            shoulders=np.array([[limb.shoulder_m for limb in limbs]]) / length,
            reach=np.array([[limb.reach_m for limb in limbs]]) / length,
            com=(course.com_nominal_m - course.origin_m)[None] / length,
            com_radius=course.com_radius_m[None] / length,
            tilt=np.array([course.tilt_limit_rad]),
            weight=np.array([course.weight_n / course.force_n]),
            force_min=np.broadcast_to(low[who.foothold], every),
            force_max=np.broadcast_to(high[who.foothold], every),
            steps=np.array([steps.com_m / length, steps.rotation_rad, steps.toe_m / length]),
            progress=np.where(ahead.any(axis=1), steps.progress_m / length, 0.0),
            ahead=ahead,
            **scaled_half_spaces([limbs], np.array([length])),
            offsets=_offsets(course) / length if course.has_soles else None,
            apart_normals=apart[1],
            apart_bounds=apart[2] / length,
            linear=steps.linear_rows(length),
            wrench=None if course.wrench is None else _scaled_wrench(course)[None, who.frame],
        )
        pieces = [(vertices - course.origin_m) / length for vertices in points]
        return Forest(numbers, pieces, least, np.concatenate([toe_sides, turn_sides]))

    @staticmethod
    def of_postures(problems: Sequence[Problem]) -> Forest:
        """Posture problems with equally many contacts, each with as many half-spaces of reach."""
        contacts = [contact for problem in problems for contact in problem.contacts]
        count, many = len(problems[0].contacts), len(problems)
        lengths = np.array([problem.unit_m for problem in problems])
        origins = np.array([problem.origin_m for problem in problems])
        body = np.array(
            [(p.com_radius_m[0], p.tilt_limit_rad, p.weight_n / p.force_n) for p in problems]
        )
        vectors = np.concatenate(
            [
                vector
                for c in contacts
                for vector in (
                    c.patch.normal,
                    c.patch.shear_reference,
                    c.shoulder_m,
                    c.force_min,
                    c.force_max,
                )
            ]
        ).reshape(many, count, 5, 3)
        scalars = np.array([(c.patch.friction, c.reach_m) for c in contacts]).reshape(
            many, count, 2
        )
        points = counts_of(problems[0].contacts)
        who = Schedule.of_posture(row_counts(problems[0].contacts), points)
        numbers = Numbers(
            schedule=who,
            candidate=who.holds[0],
            frames=contact_frames(vectors[:, :, 0], vectors[:, :, 1]),
            friction=scalars[..., 0],
            shoulders=vectors[:, :, 2] / lengths[:, None, None],
            reach=scalars[..., 1] / lengths[:, None],
            com=(
                (np.concatenate([problem.com_nominal_m for problem in problems]) - origins)
                / lengths[:, None]
            )[:, None],
            com_radius=(body[:, 0] / lengths)[:, None],
            tilt=body[:, 1],
            weight=body[:, 2],
            force_min=vectors[:, who.limb, 3],
            force_max=vectors[:, who.limb, 4],
            steps=np.zeros(3),
            progress=np.zeros(0),
            ahead=np.zeros((0, 3)),
            **scaled_half_spaces([problem.contacts for problem in problems], lengths),
            offsets=None
            if not points
            else _padded([sole_points(c.sole_m, c.patch, c.yaw_rad) for c in contacts]).reshape(
                many, count, -1, 3
            )
            / lengths[:, None, None, None],
            wrench=None
            if wrenches(problems) is None
            else np.array([_scaled_wrench(each) for each in problems]),
        )
        whole = np.concatenate([contact.region.vertices_m for contact in contacts])
        sizes = [len(contact.region.vertices_m) for contact in contacts]
        whole -= np.repeat(np.repeat(origins, count, axis=0), sizes, axis=0)
        whole /= np.repeat(np.repeat(lengths, count), sizes)[:, None]
        ends = np.cumsum(sizes).tolist()
        pieces = [whole[end - size : end] for end, size in zip(ends, sizes, strict=True)]
        return Forest(numbers, pieces, np.zeros(0), np.zeros((0, 4)))

    @property
    def patches(self) -> list[Array]:
        """The whole patches of the first problem's candidates, shape (U, 3) each."""
        return self._pieces[: len(self.numbers.candidate)]

    def replay(self, problem: int, certificate: Certificate) -> _Replayed:
        """The leaves of a tree over one of the problems: patches and force boxes are cut again as
        the nodes say.

        Arguments:
            problem: its number.

        Raises:
            InvalidInput: with the node, for a tree of another shape, and for one that does not
                cover the problem.
        """
        tree, rows = certificate.tree, certificate.multipliers
        count = self._count
        require(
            tree.shape[1:] == (5,) and rows.shape[1:] == (count,),
            "certificate: expected a tree of shape (K, 5) and multipliers of shape (leaves, "
            f"{count}), got {tree.shape} and {rows.shape}",
        )
        require(
            np.isfinite(tree).all() and np.isfinite(rows).all(),
            "certificate: expected finite numbers, got other values",
        )
        candidates = len(self.numbers.candidate)
        root = np.arange(problem * candidates, (problem + 1) * candidates)
        whole: _Node = (
            root,
            self.numbers.force_min[problem],
            self.numbers.force_max[problem],
            (None,) * len(self._least),
        )

        def children(node: _Node, where: str, kind: float, *given: float) -> list[_Node]:
            if kind not in _CUTS:
                raise InvalidInput(f"{where}: expected kind 0, 1, 2, 3 or 4, got {kind:g}")
            cut_by, used, rest = _CUTS[kind]
            if any(given[used:]):
                raise InvalidInput(f"{where}: expected {rest}, got something else")
            return cut_by(self, node, where, *given[:used])

        leaves = list(leaves_of(tree, whole, children))
        require(
            len(leaves) == len(rows),
            f"multipliers: expected a row for each of {len(leaves)} leaves, got {len(rows)}",
        )
        return leaves, rows

    def leaves(self, replayed: dict[int, _Replayed]) -> Leaves:
        """The leaves of several problems' trees, by problem, ascending."""
        nodes = [node for leaves, _ in replayed.values() for node in leaves]
        rows = np.concatenate([rows for _, rows in replayed.values()])
        largest = np.abs(rows).max(axis=1, keepdims=True)
        sizes, roots = [len(piece) for piece in self._pieces], self._roots[self._whole :]
        off = {root: sag(self._pieces[root]) for root in set(roots)}
        sags = np.zeros(len(sizes))
        sags[self._whole :] = [off[root] for root in roots]
        return Leaves(
            problem=np.repeat(list(replayed), [len(leaves) for leaves, _ in replayed.values()]),
            lower=np.array([lower for _, lower, *_ in nodes]),
            upper=np.array([upper for _, _, upper, _ in nodes]),
            pieces=np.array([pieces for pieces, *_ in nodes]),
            multipliers=rows / np.where(largest > 0.0, largest, 1.0),
            vertices=np.concatenate(self._pieces),
            first=np.concatenate([[0], np.cumsum(sizes)]),
            sag=sags,
            sides=np.array([self._rows(sides) for *_, sides in nodes]),
        )

    def _rows(self, sides: tuple[_Side, ...]) -> Array:
        """The rows (n, b) of a leaf's sides, shape (E, 4)."""
        rows = np.array(self._open)
        for e, side in enumerate(sides):
            if side is not None:
                rows[e] = half_space(side, float(self._least[e]))
        return rows

    def _parted(self, node: _Node, where: str, step: float) -> list[_Node]:
        """The parts of the side that a least step has; the first one last."""
        pieces, lower, upper, sides = node
        e = _index(step, len(sides), f"{where}: least step")
        if too_small(sides[e]):
            raise InvalidInput(f"{where}: expected a side that is wide enough to be parted")
        children = [(*sides[:e], part, *sides[e + 1 :]) for part in parts(sides[e])]
        return [(pieces, lower, upper, child) for child in reversed(children)]

    def _chosen(self, node: _Node, where: str, foothold: float, nth: float) -> list[_Node]:
        """The slot's foothold on this candidate, and not on it; the first child last."""
        pieces, lower, upper, sides = node
        candidate = self._candidate(foothold, nth, where)
        on, off = (
            np.where(self.numbers.candidate == self.numbers.candidate[candidate], -1, pieces),
            pieces.copy(),
        )
        on[candidate], off[candidate] = pieces[candidate], -1
        return [(off, lower, upper, sides), (on, lower, upper, sides)]

    def _cut(
        self, node: _Node, where: str, foothold: float, nth: float, first: float, second: float
    ) -> list[_Node]:
        pieces, lower, upper, sides = node
        candidate = self._candidate(foothold, nth, where)
        piece = int(pieces[candidate])
        if piece < 0:
            raise InvalidInput(f"{where}: expected a candidate that is open, got one that is not")
        polygon, depth = self._pieces[piece], 1 + self._depths[piece]
        if not 0.0 <= first < second < len(polygon):
            raise InvalidInput(
                f"{where}: expected border coordinates 0 ≤ a < b < {len(polygon)}, got {first:g}, "
                f"{second:g}"
            )
        if depth > _DEEPEST:
            raise InvalidInput(
                f"{where}: expected a piece of {_DEEPEST} cuts or fewer, got one more"
            )
        children: list[_Node] = []
        for part in cut(polygon, first, second):
            self._corners += len(part)
            if self._corners > _MOST_CORNERS:
                raise InvalidInput(
                    f"{where}: expected {_MOST_CORNERS} corners of pieces or fewer, got more"
                )
            child = pieces.copy()
            child[candidate] = len(self._pieces)
            self._roots.append(self._roots[piece])
            self._pieces.append(part)
            self._depths.append(depth)
            children.insert(0, (child, lower, upper, sides))
        return children

    def _split(
        self, node: _Node, where: str, contact: float, component: float, value: float
    ) -> list[_Node]:
        pieces, lower, upper, sides = node
        i = _index(contact, len(lower), f"{where}: contact")
        k = _index(component, 3, f"{where}: force component")
        if not lower[i, k] <= value <= upper[i, k]:
            raise InvalidInput(
                f"{where}: expected a force in [{lower[i, k]:g}, {upper[i, k]:g}], got {value:g}"
            )
        below, above = upper.copy(), lower.copy()
        below[i, k] = above[i, k] = value
        return [(pieces, above, upper, sides), (pieces, lower, below, sides)]

    def _candidate(self, foothold: float, candidate: float, where: str) -> int:
        """The number, among all candidates, of one of a foothold's.

        Raises InvalidInput.
        """
        begins = self.numbers.first_candidate
        p = _index(foothold, len(begins), f"{where}: foothold")
        counts = np.diff(np.append(begins, len(self.numbers.candidate)))
        return int(begins[p]) + _index(candidate, int(counts[p]), f"{where}: candidate")


_CUTS: Mapping[float, tuple[Callable[..., list[_Node]], int, str]] = {
    1: (Forest._chosen, 2, "zeros after a choice"),
    2: (Forest._cut, 4, ""),
    3: (Forest._split, 3, "a zero after a force"),
    4: (Forest._parted, 1, "zeros after a least step"),
}
"""The children of a node by its kind, how many of its numbers say them, and what the others are."""


class Refused(Exception):
    """A certificate that proves nothing, and why."""


def expect(holds: object, what: str) -> None:
    """Raise Refused, which says what was expected, where it does not hold."""
    if not holds:
        raise Refused(f"expected {what}")


def leaves_of(tree: Array, root: Node, children: Callable[..., Sequence[Node]]) -> Iterator[Node]:
    """The leaves of a tree in preorder.

    Arguments:
        tree: a row (kind, four numbers) for every node; a leaf has zeros.
        root: all that there is to choose from.
        children: of a node, from its place in words, its kind and its numbers; the first one last.

    Raises:
        InvalidInput: for a tree that does not end where its leaves do.
    """
    stack = [root]
    for at, (kind, *given) in enumerate(tree.tolist()):
        where = f"tree[{at}]"
        if not stack:
            raise InvalidInput(f"{where}: expected the end of the tree, got another node")
        node = stack.pop()
        if kind != 0:
            stack += children(node, where, kind, *given)
            continue
        if any(given):
            raise InvalidInput(f"{where}: expected zeros in a leaf, got something else")
        yield node
    if stack:
        raise InvalidInput(
            f"tree: expected {len(stack)} more nodes or more after {len(tree)}, got none"
        )


def _offsets(course: Problem) -> Array:
    """From the toe to the points of its foot, by candidate, shape (1, T, K, 3) [m]."""
    soles = {limb.name: limb.sole_m for limb in course.robot.limbs}
    return _padded(
        [
            sole_points(soles[foothold.limb], patch, yaw)
            for foothold in course.footholds
            for patch, yaw in zip(
                foothold.candidates,
                foothold.yaws_rad or [0.0] * len(foothold.candidates),
                strict=True,
            )
        ]
    )[None]


def _padded(each: list[Array]) -> Array:
    """Points of feet, with zeros where one has fewer, shape (T, K, 3)."""
    table = np.zeros((len(each), max(len(points) for points in each), 3))
    for row, points in zip(table, each, strict=True):
        row[: len(points)] = points
    return table


def _index(value: float, count: int, where: str) -> int:
    if value != int(value) or not 0 <= value < count:
        raise InvalidInput(f"{where}: expected an integer in [0, {count}), got {value:g}")
    return int(value)


def _scaled_wrench(course: Problem) -> Array:
    """Wrench on the body beside its weight at every frame, non-dimensional, shape (M, 6)."""
    if course.wrench is None:
        return np.zeros((course.frames, 6))
    unit = course.force_n * np.array([1.0, 1.0, 1.0, *(course.unit_m,) * 3])
    return np.asarray(course.wrench / unit)


def proof_report(
    certificate: Certificate,
    tolerance: float,
    bound: float,
    leaves: int,
    weakest: int,
    message: str,
) -> Report[Certificate]:
    """The report on a proof: one group, the least bound of its leaves, which has to exceed the
    tolerance.

    Arguments:
        certificate: what was judged.
        tolerance: above which a bound has to be.
        bound: the least.
        leaves: how many were checked.
        weakest: the leaf of that bound, −1 where there is none.
        message: the verdict in one line.
    """
    group = Group(
        name="bound",
        value=bound,
        limit=tolerance,
        where=f"leaf {weakest}" if weakest >= 0 else "",
        message=message,
        verdict="holds" if bound > max(tolerance, 0.0) else "violated",
    )
    return Report(
        groups=(group,),
        answer=certificate,
        tolerance=tolerance,
        figures={"lower_bound": bound, "leaves": leaves, "weakest": weakest},
        said=message,
    )


GAP = 1e-4
"""The moment residual that the certificate of a posture has to prove unless another is asked for,
non-dimensional."""


def check_certificate(
    certificate: Certificate, *, tolerance: float | None = None, any_sets: bool = False
) -> Report[Certificate]:
    """Replay the certificate's tree and bound the moment residual at every leaf; never raises for a
    bad certificate.

    Accepted when every leaf's bound exceeds ``tolerance`` (non-dimensional moment, not below 0);
    by default ``GAP`` for a posture problem and 0 for a course. ``explain`` says what the
    proof gives as its reason. Proofs about leaps have limits of their own (``leap_proof``). Raises
    InvalidInput for a certificate that does not know its problem.

    Arguments:
        any_sets: whether a course may be over sets of the robot's legs that are neither its inner
            ones nor hold all that they reach, as planners ask on the way to an answer.
    """
    subject = certificate.refuted
    if isinstance(subject, Leap):
        from .leap_proof import check_leap_certificate  # of leaps alone

        return check_leap_certificate(certificate)
    if isinstance(subject, Passage):
        from .flood import check_flood  # of passages alone

        return check_flood(certificate)
    of_course = not subject.is_posture
    if tolerance is None:
        tolerance = 0.0 if of_course else GAP
    try:
        if of_course and not any_sets:
            _check_sets(subject)
        forest = forest_of(subject)
        replayed = forest.replay(0, certificate)
    except InvalidInput as error:
        return proof_report(certificate, tolerance, 0.0, 0, -1, f"rejected: {error}")
    bounds = leaf_bounds(forest.numbers, forest.leaves({0: replayed}))
    weakest, leaves = int(np.argmin(bounds)), len(bounds)
    bound = float(bounds[weakest])
    if not (bound > max(tolerance, 0.0)):
        message = f"rejected: leaf {weakest} of {leaves} proves a residual of {bound:.3g}, expected above {tolerance:g}"
    elif math.isinf(bound):
        message = f"refuted at all leaves ({leaves}), even without the balance of moments"
    else:
        moment_nm = bound * subject.moment_scale_nm
        message = (
            f"refuted at all leaves ({leaves}): {moment_nm:.3g} Nm of moment or more are left over"
        )
    return proof_report(certificate, tolerance, bound, leaves, weakest, message)


def check_certificates(certificates: Sequence[Certificate]) -> Array:
    """The ``lower_bound`` of ``check_certificate`` for many posture problems at once, shape (B,); 0
    for a bad tree.

    A problem is refuted where this exceeds the tolerance, not below 0. Problems may have any number
    of contacts.
    """
    problems = [posture_problem(certificate) for certificate in certificates]
    bounds = np.zeros(len(problems))
    kinds = [(row_counts(problem.contacts), counts_of(problem.contacts)) for problem in problems]
    for kind in set(kinds):
        rows = [row for row, of_kind in enumerate(kinds) if of_kind == kind]
        forest = Forest.of_postures([problems[row] for row in rows])
        replayed: dict[int, _Replayed] = {}
        for q, row in enumerate(rows):
            try:
                replayed[q] = forest.replay(q, certificates[row])
            except InvalidInput:
                continue
        if replayed:
            begins = np.cumsum([0, *(len(leaves) for leaves, _ in replayed.values())])[:-1]
            each = leaf_bounds(forest.numbers, forest.leaves(replayed))
            bounds[[rows[q] for q in replayed]] = np.minimum.reduceat(each, begins)
    return bounds


def _check_sets(course: Problem) -> None:
    """Raise InvalidInput where a proof over a course's sets of legs says nothing of anything: where
    they neither hold all that the legs of the robot's file reach, nor are the inner ones, of which
    it then is.
    """
    if not course.robot.own:
        return
    from ..robot.reach_sets import contains_all

    where = f"robot {course.robot.name}"
    balls = (
        f"{where}: expected feet that are balls, got soles, which may touch with any part of them"
    )
    require(not course.has_soles, balls)
    require(
        contains_all(course.robot, course.tilt_limit_rad) or course.sets == "inner",
        f"{where}: expected sets that hold all that its legs reach wherever its centre of mass is, "
        "got smaller ones",
    )


def posture_problem(certificate: Certificate) -> Problem:
    """The posture problem that a certificate is of.

    Raises InvalidInput for one of anything else.
    """
    problem = certificate.refuted
    if not (isinstance(problem, Problem) and problem.is_posture):
        raise InvalidInput(
            f"certificate: expected one of a posture problem, got one of a {type(problem).__name__}"
        )
    return problem


def forest_of(subject: Problem) -> Forest:
    """The numbers and patches of a posture problem or a course."""
    return Forest.of_postures((subject,)) if subject.is_posture else Forest.of_course(subject)
