"""Certificates replayed in exact arithmetic: the numbers of a file as the fractions that they are,
and balls that are rounded outwards (Arb) where a root enters.

A leaf weighs the problem's constraints by its multipliers: equations x = 0 by any vector y, limits
‖x‖ ≤ b by y and its length, a·x ≤ b by a number σ ≥ 0. Every answer makes

    Σ ν_F·(Σ f + G) + ν_M·(Σ p × f + c × G + M) + Σ (y·x − ‖y‖ b) + Σ σ (a·x − b)  ≤  0,

with G what acts at the centre of mass c beside the feet, and M its moment. The sum is linear in c,
in the rotation Θ, and in each toe p and its forces f, so its least value separates; above zero,
nothing answers the problem. A number becomes a ball by a root alone: the length of a vector, the
axes of a patch. A leaf without one is decided in rational numbers.

Nothing here is taken from the planners or from the verifier in floating point: it reads the JSON of
the problem. ``Certificate`` says what the numbers of a tree mean.
"""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import Any

from flint import arb, ctx, fmpq

from ..errors import require

BITS = 192
"""Bits of the balls' centres."""
_G = fmpq(*(9.81).as_integer_ratio())
_ZERO, _ONE = fmpq(0), fmpq(1)
_UP = [_ZERO, _ZERO, _ONE]
Number = Any
"""A fraction ``fmpq``, or a ball ``arb``."""
Vector = list[Any]
_Row = tuple[list[tuple[tuple[str, Any], Any]], Any, Any]
"""A constraint: for each of its variables the way its multiplier y weighs it (a number w: w y; a
vector v: y × v, or y v where y is a number), what is constant, and the limit of a length."""
_Piece = tuple[list[Vector], Number, Vector]
"""Corners of a candidate's piece, most that a toe of it is off their hull, and the normal."""


class _Refused(Exception):
    """Why a certificate proves nothing."""


def _expect(holds: object, otherwise: str) -> None:
    """Raise _Refused with these words where something does not hold."""
    if not holds:
        raise _Refused(otherwise)


@dataclass(frozen=True)
class _Node:
    """Choices that a node of the tree leaves open."""

    pieces: list[dict[int, _Piece]]
    boxes: list[tuple[Vector, Vector]]
    sides: list[list[Vector] | None] = field(default_factory=list)
    timings: list[int] = field(default_factory=list)


@dataclass(frozen=True)
class _Sum:
    """A problem, as its leaves weigh it.

    Arguments:
        rows: the constraints of a leaf in the order of its multipliers.
        close: the least value of slope·x over a variable other than toes and forces, by its kind.
        patches: axes and friction of every candidate of every foothold.
        carried: (stance, foothold) of every force.
        root: all that there is to choose.
    """

    rows: Callable[[_Node], Iterator[_Row]]
    close: Mapping[str, Callable[[Any, Vector], Number]]
    patches: list[list[tuple[list[Vector], Number]]]
    carried: list[tuple[int, int]]
    root: _Node


def check_exact(
    question: Mapping[str, Any], tree: Sequence[Sequence[float]], rows: Sequence[Sequence[float]]
) -> tuple[bool, list[str], str]:
    """Replay a certificate of a posture problem, a course or a leap in exact arithmetic.

    Arguments:
        question: the problem as its file has it.
        tree: nodes in preorder, five numbers each.
        rows: multipliers of the leaves in preorder.

    Returns:
        Whether the tree covers every choice, every multiplier lies in its cone and every leaf's
        bound is above zero; the arithmetic of each leaf (rational, balls, or empty where nothing is
        left to choose); and a verdict in one line.

    Raises:
        InvalidInput: for proofs that are not weighed here: of passages, and of feet with soles.
    """
    kinds, where = list[str](), ""
    with ctx.workprec(BITS):
        problem = _leap(question) if "phases" in question else _course(question)
        try:
            for node in _leaves(problem.root, tree):
                where = f"leaf {len(kinds)}: "
                given = iter(_exact(rows[len(kinds)]) if len(kinds) < len(rows) else ())
                bound = _bound(problem, node, given)
                _expect(next(given, None) is None, "expected fewer multipliers")
                if bound is not None and not bound > 0:
                    raise _Refused(f"expected a bound above 0, got {float(bound):.3g}")
                kind = "balls" if isinstance(bound, arb) else "rational"
                kinds.append("empty" if bound is None else kind)
            many = f"expected {len(kinds)} rows of multipliers, got {len(rows)}"
            _expect(len(kinds) == len(rows), many)
        except (_Refused, StopIteration) as error:
            why = error if isinstance(error, _Refused) else "expected more multipliers"
            return False, kinds, f"rejected: {where}{why}"
    runs = (f"{len([*run])} {kind}" for kind, run in itertools.groupby(kinds))
    return True, kinds, f"refuted exactly at all leaves ({len(kinds)}, in order {', '.join(runs)})"


def _leaves(root: _Node, tree: Sequence[Sequence[float]]) -> Iterator[_Node]:
    """The leaves of a tree; raises _Refused where it does not cover all that there is to choose."""
    stack, cuts = [root], (_chosen, _cut, _split, _timed if root.timings else _parted)
    for at, (kind, *numbers) in enumerate(tree):
        _expect(stack, f"tree[{at}]: expected its end, got another node")
        node = stack.pop()
        if kind == 0:
            yield node
            continue
        try:
            stack += reversed(cuts[_whole(kind - 1, len(cuts))](node, *numbers))
        except LookupError:
            raise _Refused(f"tree[{at}]: expected a cut of what is open, got another") from None
    _expect(not stack, f"tree: expected {len(stack)} more nodes or more, got none")


def _whole(value: float, count: int) -> int:
    """A whole number below a count; raises IndexError for another."""
    if value not in range(count):
        raise IndexError
    return int(value)


def _put(items: Any, at: int, value: Any) -> list[Any]:
    """A copy of a list with another item at a place."""
    return [*items[:at], value, *items[at + 1 :]]


def _chosen(node: _Node, p: float, j: float, *_: float) -> list[_Node]:
    """On this candidate, and not on it."""
    foothold = _whole(p, len(node.pieces))
    there = node.pieces[foothold]
    one = {j: there[int(j)] for j in [_whole(j, 1 + max(there, default=0))]}
    others = {k: piece for k, piece in there.items() if k != j}
    return [replace(node, pieces=_put(node.pieces, foothold, each)) for each in (one, others)]


def _cut(node: _Node, p: float, j: float, first: float, second: float) -> list[_Node]:
    """A piece on either side of a chord; how far rounded corners leave points uncovered is added to
    how far a toe may be off it.

    A point of the hull is between one of the corners' hull on either side of the plane through the
    chord along the normal, and the segment of both crosses the plane in the hull of the crossings of
    pairs of corners: no farther from the chord than the farthest of these.
    """
    foothold = _whole(p, len(node.pieces))
    corners, off, normal = node.pieces[foothold][int(j)]
    if j not in node.pieces[foothold] or not 0.0 <= first < second < len(corners):
        raise IndexError
    begin, end = (
        _plus(corners[int(at)], _minus(corners[int(at) - len(corners) + 1], corners[int(at)]), by)
        for at in (first, second)
        for by in [_exact(at) - int(at)]
    )
    here = corners[math.floor(first) + 1 : math.ceil(second)]
    there = corners[math.floor(second) + 1 :] + corners[: math.ceil(first)]
    across = _cross(_minus(end, begin), normal)
    high = [_dot(across, _minus(v, begin)) for v in here + there]
    if sum(high[: len(here)], _ZERO) < sum(high[len(here) :], _ZERO):
        high = [-each for each in high]
    every = [*zip(here + there, high, strict=True)]
    strays = [v for n, (v, h) in enumerate(every) if (h < 0 if n < len(here) else h > 0)]
    for (v, a), (w, b) in itertools.product(every, every):
        if a > 0 > b:
            strays.append(_plus(v, _minus(w, v), a / (a - b)))
    off += _root(max((_square_off(v, begin, end) for v in strays), default=_ZERO))
    parts = ([begin, *here, end], [end, *there, begin])
    children = [{**node.pieces[foothold], int(j): (part, off, normal)} for part in parts]
    return [replace(node, pieces=_put(node.pieces, foothold, each)) for each in children]


def _split(node: _Node, b: float, component: float, value: float, _: float) -> list[_Node]:
    """Forces up to a value, and from it on."""
    at, axis, cut = _whole(b, len(node.boxes)), _whole(component, 3), _exact(value)
    low, high = node.boxes[at]
    if not low[axis] <= cut <= high[axis]:
        raise IndexError
    halves = ((low, _put(high, axis, cut)), (_put(low, axis, cut), high))
    return [replace(node, boxes=_put(node.boxes, at, half)) for half in halves]


def _timed(node: _Node, timing: float, *_: float) -> list[_Node]:
    """With this timing, and with the others."""
    others = [each for each in node.timings if each != timing]
    if len(others) + 1 != len(node.timings) or not others:
        raise IndexError
    return [replace(node, timings=each) for each in ([int(timing)], others)]


def _parted(node: _Node, e: float, *_: float) -> list[_Node]:
    """The octants of a least step's directions, or the four parts of a side."""
    at = _whole(e, len(node.sides))
    side = node.sides[at]
    if side is None:
        signs = itertools.product((_ONE, -_ONE), repeat=3)
        parts = [[_put([_ZERO] * 3, n, s) for n, s in enumerate(each)] for each in signs]
    else:
        a, b, c = side
        ab, bc, ca = (_unit(_plus(v, w)) for v, w in ((a, b), (b, c), (c, a)))
        parts = [[ab, bc, ca], [a, ab, ca], [b, bc, ab], [c, ca, bc]]
    return [replace(node, sides=_put(node.sides, at, part)) for part in parts]


def _bound(problem: _Sum, node: _Node, given: Iterator[Number]) -> Number | None:
    """The least value of a leaf's sum, None where nothing is left to choose."""
    total, slopes = _ZERO, defaultdict[tuple[str, Any], Vector](lambda: [_ZERO] * 3)
    for terms, fixed, limit in problem.rows(node):
        if isinstance(fixed, list):
            y: Any = [next(given) for _ in range(3)]
            total += _dot(y, fixed) - (limit * _norm(y) if limit else 0)
        else:
            y = next(given)
            total += y * fixed
            if y < 0:
                raise _Refused(f"expected multipliers in their cones, got {float(y):.3g} below 0")
        for variable, way in terms:
            slopes[variable] = _plus(slopes[variable], _weighed(way, y))
    for (kind, which), slope in list(slopes.items()):
        total += problem.close[kind](which, slope) if kind in problem.close else 0
    for p, pieces in enumerate(node.pieces):
        forces = [
            (slopes["force", s], slopes["moment", s], box)
            for (s, foothold), box in zip(problem.carried, node.boxes, strict=True)
            if foothold == p
        ]
        values = [
            _placed(*problem.patches[p][j], piece, slopes["toe", p], forces)
            for j, piece in pieces.items()
        ]
        if not (there := [each for each in values if each is not None]):
            return None
        total += _least(there)
    return total


def _weighed(way: Any, y: Any) -> Vector:
    """The slope of a variable, see ``_Row``."""
    if isinstance(y, list):
        return _cross(y, way) if isinstance(way, list) else _times(y, way)
    return _times(way, y)


def _placed(
    axes: list[Vector],
    friction: Number,
    piece: _Piece,
    slope: Vector,
    forces: list[tuple[Vector, Vector, tuple[Vector, Vector]]],
) -> Number | None:
    """The least contribution of a toe on a piece, and of the forces on it; None where the box of one
    misses the cone.
    """
    for _, _, (low, high) in forces:
        most = friction * max(high[0], _ZERO)
        shear = [max(a, -b, _ZERO) for a, b in zip(low[1:], high[1:], strict=True)]
        if shear[0] ** 2 + shear[1] ** 2 > most**2 or (friction > 0 > high[0]):
            return None
    corners, off, _ = piece
    values = []
    for corner in corners:
        value = _dot(slope, corner)
        for push, turn, box in forces:
            nu = _plus(push, _cross(turn, corner))
            value += _work([_dot(nu, axis) for axis in axes], box, friction)
        values.append(value)
    value = _least(values)
    if off != 0:
        value -= off * _norm(slope)
        for _, turn, (low, high) in forces:
            far = _norm([max(abs(a), abs(b)) for a, b in zip(low, high, strict=True)])
            value -= off * _norm(turn) * far
    return value


def _work(a: Vector, box: tuple[Vector, Vector], friction: Number) -> Number:
    """A lower bound on min {a·f : f in the box, ‖(f_y, f_z)‖ ≤ μ f_n}.

    Every κ in the plane gives one: (a_n − μ‖κ‖) f_n + (a_t − κ)·f_t is least at a corner of the box.
    The best of the places where the greatest may lie is chosen in floating point.
    """
    low, high = box
    ends = [max(low[0], _ZERO) if friction > 0 else low[0], max(high[0], _ZERO)]
    (n, y, z), mu = (float(each) for each in a), float(friction)
    least, most = ([float(each) for each in side] for side in box)
    cone, ring = [mu * float(end) for end in ends], max(n, 0.0) / mu if mu > 0.0 else 0.0
    tried: list[tuple[float, ...]] = [(y, z), (0.0, 0.0), (y, 0.0), (0.0, z)]
    if min(*most[1:], *(-each for each in least[1:])) < cone[1]:  # else the cone lies in the box
        for fixed, other, order in ((z, 1, 1), (y, 2, -1)):
            bounds = itertools.product((least[other], most[other]), cone)
            steep = [(b, c * c - b * b) for b, c in bounds if abs(b) < c]
            rim = math.sqrt(max(ring * ring - fixed * fixed, 0.0))
            along = (rim, -rim, *(-abs(fixed) * b / math.sqrt(s) for b, s in steep))
            tried += [(one, fixed)[::order] for one in along]
        for corner in itertools.product((least[1], most[1]), (least[2], most[2])):
            size = max(math.hypot(*corner), 1e-12)
            tried.append((-ring * corner[0] / size, -ring * corner[1] / size))

    def value(kappa: tuple[float, ...]) -> float:
        first = n - mu * math.hypot(*kappa)
        rest = zip((y, z), kappa, least[1:], most[1:], strict=True)
        sides = sum(min((one - k) * lo, (one - k) * hi) for one, k, lo, hi in rest)
        return sides + min(first * float(ends[0]), first * float(ends[1]))

    kappa = _exact(max(tried, key=value))
    first = a[0] - friction * _root(kappa[0] ** 2 + kappa[1] ** 2)
    total = _least([first * end for end in ends])
    for one, k, lo, hi in zip(a[1:], kappa, low[1:], high[1:], strict=True):
        total += _least([(one - k) * lo, (one - k) * hi])
    return total


def _course(data: Mapping[str, Any]) -> _Sum:
    """A posture problem or a course, in units of its length and force."""
    one = "contacts" in data
    known = one or "placements" in data
    require(known, "exact: expected a proof of a posture, a course or a leap")
    body = data if one else data["robot"]
    limbs = data["contacts"] if one else body["limbs"]
    points = all(limb.get("sole_m") is None for limb in limbs)
    require(points, "exact: expected point feet, got soles")
    names = [limb["leg" if one else "name"] for limb in limbs]
    placed = data.get("placements") or [
        {**limb, "limb": limb["leg"], "frame": 0, "candidates": [limb]} for limb in limbs
    ]
    size, unit = (
        max(max(map(abs, e["shoulder_m"])) + e["reach_m"] for e in limbs),
        data["length_scale_m"],
    )
    length = _exact(unit if size <= 30 * unit and unit <= 30 * size else size)
    weight = _exact(body["mass_kg"]) * _exact(data["gravity_m_s2"])
    force = _exact(data.get("force_scale_n") or 0) or weight
    legs, tilt = [_limb(limb, length) for limb in limbs], _exact(data["tilt_limit_rad"])
    coms, radii = data["com_nominal_m"], data["com_radius_m"]
    coms, radii = ([coms], [radii]) if one else (coms, radii)
    origin = [_exact(10.0 * round(x / 10.0)) for x in coms[0]]
    com = [_times(_minus(_exact(place), origin), 1 / length) for place in coms]
    frames, steps, many = range(len(com)), data.get("steps", {}), range(len(legs))
    holds = [
        [max(p for p, e in enumerate(placed) if e["limb"] == n and e["frame"] <= k) for n in names]
        for k in frames
    ]
    pairs = [*itertools.pairwise(holds)]
    lifts, stances = [*data.get("lifts", [[]]), data.get("next_lift", [])], list[Any]()
    for k in frames:
        sets = [[i for i in many if names[i] not in up] for up in lifts[k : k + 2] if up]
        sets = [limbs for n, limbs in enumerate(sets) if limbs and limbs not in sets[:n]]
        stances += [(k, limbs) for limbs in sets or [[*many]]]
    given = data.get("wrench") or ([0.0] * 6 if one else [[0.0] * 6] * len(com))
    pushes = [_times(_exact(wrench), 1 / force) for wrench in ([given] if one else given)]
    moves = [(p, q) for two in pairs for p, q in zip(*two, strict=True) if p != q]
    most_com, most_toe = (_exact(steps.get(name, 0)) / length for name in ("com_m", "toe_m"))
    ways = [_minus(b, a) for a, b in itertools.pairwise(com)]
    ahead = [_unit(way) if _norm(way) * length > _exact(1e-9) else [_ZERO] * 3 for way in ways]
    apart = [
        (two[names.index(pair["limb"])], two[names.index(pair["other"])], a, b / length)
        for before, two in pairs
        for pair in body.get("relative_reach") or ()
        if before[names.index(pair["limb"])] != two[names.index(pair["limb"])]
        for a, b in zip(*(_exact(pair["rows"][e]) for e in ("normals", "bounds_m")), strict=True)
    ]
    least_toe, least_turn = (_exact(steps.get(f"least_{e}", 0)) for e in ("toe_m", "rotation_rad"))
    toes = len(moves) if least_toe else 0

    def rows(node: _Node) -> Iterator[_Row]:
        for s, (k, _) in enumerate(stances):
            yield [(("force", s), 1)], _plus(pushes[k][:3], _UP, -weight / force), None
        for s, (k, _) in enumerate(stances):
            acting = _plus(pushes[k][:3], _UP, -weight / force)
            terms = [(("moment", s), 1), (("com", k), _times(acting, -1))]
            yield terms, _times(pushes[k][3:], 1 / length), None
        for k, i in itertools.product(frames, many):
            shoulder, reach, _ = legs[i]
            terms = [(("toe", holds[k][i]), 1), (("com", k), -1), (("turn", k), shoulder)]
            yield terms, _times(shoulder, -1), reach
        for kind, most in (("com", most_com), ("turn", _exact(steps.get("rotation_rad", 0)))):
            for k in frames[1:]:
                yield [((kind, k), 1), ((kind, k - 1), -1)], [_ZERO] * 3, most
        for k, way in zip(frames[1:], ahead, strict=True):
            least = _exact(steps["progress_m"]) / length if any(way) else _ZERO
            yield [(("com", k), _times(way, -1)), (("com", k - 1), way)], least, None
        for before, after in moves:
            yield [(("toe", after), 1), (("toe", before), -1)], [_ZERO] * 3, most_toe
        for k, i in itertools.product(frames, many):
            for a, b in legs[i][2]:  # (a + Θ × a)·(q − c) ≤ b, the ball limits what is bilinear
                terms = [(("toe", holds[k][i]), a), (("com", k), _times(a, -1))]
                yield (
                    [*terms, (("turn", k), _cross(a, legs[i][0])), (("bent", (k, i)), a)],
                    -b,
                    None,
                )
        for limb, other, a, b in apart:
            yield [(("toe", other), a), (("toe", limb), _times(a, -1))], -b, None
        for (before, after), side in zip(moves, node.sides[:toes], strict=False):
            a, b = _half_space(side, least_toe / length)
            yield [(("toe", after), _times(a, -1)), (("toe", before), a)], b, None
        for k in frames[1:]:
            turned = [] if steps.get("yaw_rad") is None else [_UP, _times(_UP, -1)]
            limits = [(a, -_exact(steps["yaw_rad"])) for a in turned]
            for side in node.sides[toes + k - 1 : toes + k]:
                a, b = _half_space(side, least_turn)
                limits.append((_times(a, -1), b))
            for a, b in limits:
                yield [(("turn", k), a), (("turn", k - 1), _times(a, -1))], b, None

    def bent(at: tuple[int, int], slope: Vector) -> Number:
        shoulder, reach, _ = legs[at[1]]
        return -tilt * _swung(slope) * (reach + tilt * _swung(shoulder))

    bounds = [
        [_exact(data[e] if each.get(e) is None else each[e]) for e in ("force_min", "force_max")]
        for each in placed
    ]
    carried = [(s, holds[k][i]) for s, (k, on) in enumerate(stances) for i in on]
    root = _Node(
        [_pieces(each, origin, length) for each in placed],
        [(bounds[p][0], bounds[p][1]) for _, p in carried],
        sides=[None] * (toes + (len(pairs) if least_turn else 0)),
    )
    close = {
        "com": lambda k, x: _dot(x, com[k]) - _exact(radii[k]) / length * _norm(x),
        "turn": lambda k, x: -tilt * sum(map(abs, x), _ZERO),
        "bent": bent,
    }
    return _Sum(rows, close, [[*map(_axes, e["candidates"])] for e in placed], carried, root)


def _half_space(side: list[Vector] | None, least: Number) -> tuple[Vector, Number]:
    """n and b with n·Δ ≥ b for the Δ of a side that are as long as the least step; zeros where it is
    open.
    """
    if side is None:
        return [_ZERO] * 3, _ZERO
    a, b, c = side
    normal = _unit(_cross(_minus(b, a), _minus(c, a)))
    normal = normal if _dot(normal, a) > 0 else _times(normal, -1)
    return normal, least * _least([_dot(normal, corner) for corner in side])


def _leap(data: Mapping[str, Any]) -> _Sum:
    """A leap in metres, seconds, and forces in units of the weight."""
    names = [limb["name"] for limb in data["robot"]["limbs"]]
    legs, phases, feet = (
        [_limb(e, _ONE) for e in data["robot"]["limbs"]],
        data["phases"],
        data["footholds"],
    )
    start, goal = ({e: _exact(v) for e, v in data[which].items()} for which in ("start", "goal"))
    limits = {e: _exact(v) for e, v in data["limits"].items() if v is not None}
    tilt, bend = limits["tilt_rad"], fmpq(3, 2) * limits["tilt_rad"] ** 2
    number = {(foot["limb"], foot["phase"]): j for j, foot in enumerate(feet)}
    holds, held = list[list[int]](), dict[str, int]()
    for q, phase in enumerate(phases):
        held = {n: number.get((n, q), held.get(n, -1)) for n in phase["limbs"]}
        holds += [[held.get(n, -1) for n in names]] * phase["intervals"]
    moving = [
        max(abs(x) for e in ("velocity_m_s", "momentum_m2_s") for x in state[e])
        for state in (start, goal)
    ]
    ends = zip((0, len(holds) - 1), moving, strict=True)
    rests = [k for k, speed in ends if speed <= _exact(1e-9)]
    nobody = [0] * len(names)
    around = zip([nobody, *holds], holds, [*holds[1:], nobody], strict=False)
    carried, boxes = list[tuple[int, int]](), list[tuple[Vector, Vector]]()
    for k, row in enumerate(zip(*each, strict=True) for each in around):
        for was, j, then in row:
            if j >= 0:
                share = min(
                    limits["ramp"] if was < 0 else _ONE,
                    limits.get("lift", limits["ramp"]) if then < 0 else _ONE,
                )
                most = limits["force_share"] * share
                shear = most * max(_exact(patch["friction"]) for patch in feet[j]["candidates"])
                carried.append((k, j))
                boxes.append(([_ZERO, -shear, -shear], [most, shear, shear]))

    def rows(node: _Node) -> Iterator[_Row]:
        _expect(len(node.timings) == 1, "expected one timing")
        lasts = [
            _exact(s) / phase["intervals"]
            for s, phase in zip(data["timings_s"][node.timings[0]], phases, strict=True)
            for _ in range(phase["intervals"])
        ]
        times = [_ZERO, *itertools.accumulate(lasts)]

        def com(time: Number) -> tuple[Vector, list[Number]]:
            """c = place + Σ share F at a time, F the sums of forces of the intervals."""
            place = _plus(start["com_m"], start["velocity_m_s"], time)
            since = [max(time - each, _ZERO) ** 2 for each in times]
            shares = [_G * (a - b) / 2 for a, b in itertools.pairwise(since)]
            return _plus(place, _UP, -_G * time**2 / 2), shares

        def forces(shares: list[Number], by: Any) -> list[tuple[tuple[str, Any], Any]]:
            return [
                (("force", k), _times(by, share) if isinstance(by, list) else share * by)
                for k, share in enumerate(shares)
            ]

        stands = list[tuple[Number, Vector, list[Number], int, int]]()
        for index in range(2 * len(holds) + 1):
            k, odd = divmod(index, 2)
            now = holds[k] if k < len(holds) else [-1] * len(names)
            last = holds[k - 1] if k > 0 and not odd else now
            time = (times[k] + times[k + 1]) / 2 if odd else times[k]
            both = [here if here >= 0 else before for here, before in zip(now, last, strict=True)]
            stands += [(time, *com(time), i, j) for i, j in enumerate(both) if j >= 0]
        for time, place, shares, i, j in stands:
            shoulder, reach, _ = legs[i]
            terms = [(("toe", j), 1), (("turn", time), shoulder), *forces(shares, -1)]
            yield terms, _times(_plus(shoulder, place), -1), reach + bend * _norm(shoulder)
        for time, place, shares, i, j in stands:
            shoulder, reach, spaces = legs[i]
            far = reach + tilt * _swung(shoulder) + bend * _norm(shoulder)
            for a, b in spaces:
                room = tilt * _swung(a) * far
                terms = [(("toe", j), a), (("turn", time), _cross(a, shoulder))]
                fixed = -_dot(a, place) - b - room
                yield [*terms, *forces(shares, _times(a, -1))], fixed, None
        for _, place, shares, _, j in stands:
            terms = [(("toe", j), _UP), *forces(shares, _times(_UP, -1))]
            yield terms, limits["height_m"] - place[2], None
        place, shares = com(times[-1])
        yield forces(shares, 1), _minus(place, goal["com_m"]), _exact(data["goal_radius_m"])
        speed = _plus(_minus(start["velocity_m_s"], goal["velocity_m_s"]), _UP, -_G * times[-1])
        yield forces([_G * last for last in lasts], 1), speed, None
        for k in rests:
            yield [(("force", k), 1)], _times(_UP, -1), None
        for k in rests:
            place, shares = com(_ZERO if k == 0 else times[-1])
            yield [(("moment", k), 1), *forces(shares, _UP)], _cross(_UP, place), None

    root = _Node(
        [_pieces(foot, [_ZERO] * 3, _ONE) for foot in feet],
        boxes,
        timings=[*range(len(data["timings_s"]))],
    )
    close = {"turn": lambda _, x: -tilt * sum(map(abs, x), _ZERO)}
    return _Sum(rows, close, [[*map(_axes, foot["candidates"])] for foot in feet], carried, root)


def _limb(limb: Mapping[str, Any], length: Number) -> tuple[Vector, Number, list[Any]]:
    """Shoulder, reach, and half-spaces of reach."""
    rows = limb.get("reach_rows") or {"normals": [], "bounds_m": []}
    spaces = zip(_exact(rows["normals"]), _exact(rows["bounds_m"]), strict=True)
    shoulder = _times(_exact(limb["shoulder_m"]), 1 / length)
    return shoulder, _exact(limb["reach_m"]) / length, [(a, b / length) for a, b in spaces]


def _pieces(foothold: Mapping[str, Any], origin: Vector, length: Number) -> dict[int, _Piece]:
    """The whole patches of a foothold's candidates, or the toe that stands."""
    toe, pieces = foothold.get("toe_m"), dict[int, _Piece]()
    for j, patch in enumerate(foothold["candidates"]):
        corners = _exact(patch["vertices_m"] if toe is None else [toe])
        places = [_times(_minus(corner, origin), 1 / length) for corner in corners]
        pieces[j] = (places, _ZERO, _exact(patch["normal"]))
    return pieces


def _axes(patch: Mapping[str, Any]) -> tuple[list[Vector], Number]:
    """Axes of a patch's contact frame, and its friction."""
    normal, reference = _unit(_exact(patch["normal"])), _exact(patch["shear_reference"])
    z = _unit(_plus(reference, normal, -_dot(reference, normal)))
    return [normal, _cross(z, normal), z], _exact(patch["friction"])


def _square_off(point: Vector, begin: Vector, end: Vector) -> Number:
    """The square of a point's distance from a segment."""
    way, off = _minus(end, begin), _minus(point, begin)
    along = _dot(off, way) / (_dot(way, way) or _ONE)
    off = _plus(off, way, -min(max(along, _ZERO), _ONE))
    return _dot(off, off)


def _exact(value: Any) -> Any:
    """A number as the fraction that it is, or a list of such."""
    if isinstance(value, Sequence):
        return [_exact(each) for each in value]
    return fmpq(*float(value).as_integer_ratio())


def _plus(a: Vector, b: Vector, times: Number = 1) -> Vector:
    return [x + times * y for x, y in zip(a, b, strict=True)]


def _minus(a: Vector, b: Vector) -> Vector:
    return _plus(a, b, -1)


def _times(a: Vector, by: Number) -> Vector:
    return [x * by for x in a]


def _dot(a: Vector, b: Vector) -> Number:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return [a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)]


def _norm(a: Vector) -> Number:
    return _root(_dot(a, a))


def _swung(a: Vector) -> Number:
    """The largest ‖Θ × a‖ over |Θ_i| ≤ 1."""
    turns = [_cross([1, y, z], a) for y in (1, -1) for z in (1, -1)]
    return _root(max(_dot(each, each) for each in turns))


def _unit(a: Vector) -> Vector:
    square = _dot(a, a)
    require(square > 0, "exact: expected vectors of some length, got none")
    return _times(a, 1 / _root(square))


def _root(square: Number) -> Number:
    """√x: a fraction where it is one; of a ball about zero, no less than any root in it."""
    if isinstance(square, arb):
        return square.sqrt() if square > 0 else arb(square.abs_upper()).sqrt()
    (p, left), (q, over) = square.p.sqrtrem(), square.q.sqrtrem()
    return arb(square).sqrt() if left or over else fmpq(p, q)


def _least(values: Vector) -> Number:
    """The least of some numbers, a ball where one is."""
    if any(isinstance(value, arb) for value in values):
        return reduce(lambda a, b: arb(a).min(arb(b)), values)
    return min(values)
