"""Algorithm E2 (EnvelopeFitting): envelopes around the clusters of a mixture, as printed and
improved; and a box a terrain, for mode switching (Lin et al. §IV-A, end).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.stats import chi2
from sklearn.mixture import GaussianMixture

from stancekit.envs.data.dataset import Dataset
from stancekit.envs.distributions.postures import LAW, distribution
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem import Problem
from stancekit.planners.relaxation.boxes import Modes, world_points
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.search.exact import Exact

from .selector import quantile_box

_CLEARANCE = 1e-4
"""Distance outside the box that an excluded point must have (non-dimensional)."""


def largest_box(
    centre: Array, excluded: Array, low: Array, high: Array, *, time_limit_s: float = 12.0
) -> tuple[Array, Array, float]:
    """Boundary_fit as printed: the widest box (summed) in [low, high] around ``centre`` without any
    excluded point.

    A mixed-integer program on HiGHS: a binary z_jd says that point j lies outside side d, on the
    side of the centre on which it lies at all, and every point has one.

    Arguments:
        centre, low, high: shape (D,).
        excluded: shape (J, D).

    Returns:
        (low, high, gap): the best box found and the relative gap that was left at the time limit;
        with nothing found, the box shrunk onto the centre.
    """
    count, size = excluded.shape
    below = excluded < centre  # such a point can only be cut off by the lower bound
    distance = np.abs(excluded - centre)
    span = np.where(below, centre - low, high - centre)
    # Widths: w_d^- = centre − low_d and w_d^+ = high_d − centre; z_jd = 1 ⇒ w_d^± ≤ distance_jd −
    # clearance.
    side = np.where(below, 0, size) + np.arange(size)
    z = 2 * size + np.arange(count * size).reshape(count, size)
    rows = np.arange(count * size)
    cut = np.maximum(span - np.maximum(distance - _CLEARANCE, 0.0), 0.0)
    matrix = sp.csr_matrix(
        (
            np.concatenate([np.ones(count * size), cut.ravel()]),
            (np.concatenate([rows, rows]), np.concatenate([side.ravel(), z.ravel()])),
        ),
        shape=(count * size, 2 * size + count * size),
    )
    one = sp.csr_matrix(
        (np.ones(count * size), (np.repeat(np.arange(count), size), z.ravel())),
        shape=(count, matrix.shape[1]),
    )
    possible = ((distance > _CLEARANCE) & (span > 0.0)).ravel()
    answer = milp(
        c=np.concatenate([-np.ones(2 * size), np.zeros(count * size)]),
        constraints=[
            LinearConstraint(matrix, -np.inf, span.ravel()),
            LinearConstraint(one, 1.0, np.inf),
        ],
        integrality=np.concatenate([np.zeros(2 * size), np.ones(count * size)]),
        bounds=Bounds(
            np.zeros(matrix.shape[1]),
            np.concatenate([centre - low, high - centre, possible.astype(float)]),
        ),
        options={"time_limit": time_limit_s},
    )
    if answer.x is None:
        return centre.copy(), centre.copy(), float("inf")
    widths = answer.x[: 2 * size]
    return centre - widths[:size], centre + widths[size:], float(answer.mip_gap)


_DOMAIN = 1.0
"""p and f lie in [−1, 1] by the choice of scales (Lin et al. §II)."""


@dataclass(frozen=True, kw_only=True)
class MixtureFit:
    """Result of one run of Algorithm E2.

    Arguments:
        shares: share of S in each envelope.
        gaps: what was left of each Boundary_fit program's gap at its time limit.
    """

    envelopes: tuple[Envelope, ...]
    shares: tuple[float, ...]
    gaps: tuple[float, ...] = ()


def fit_as_printed(
    points: Array,
    excluded: Array,
    *,
    clusters: int = 1,
    threshold: float = 0.05,
    seed: int = 0,
    time_limit_s: float = 12.0,
) -> MixtureFit:
    """Algorithm E2, line by line.

    Line 3: cluster means of a mixture. Line 4: Boundary_fit, the largest box around a mean without
    points of S̄ (``boundary.largest_box``, stopped at the time limit). Line 5: the points of S in
    it. Line 6: those that belong to the cluster with a probability above p_th (``_membership``).
    Line 7: their exterior boundary; where lines 5 and 6 leave no point, the fitted box itself.

    Arguments:
        points: S, shape (K, N, 6).
        excluded: S̄, shape (J, N, 6).
        threshold: p_th.
    """
    flat, bad = points.reshape(len(points), -1), excluded.reshape(len(excluded), -1)
    mixture = mixture_of(flat, clusters, seed)
    belongs = _membership(mixture, flat)
    low, high = np.full(flat.shape[1], -_DOMAIN), np.full(flat.shape[1], _DOMAIN)
    envelopes, gaps = [], []
    for k in range(clusters):
        centre = np.clip(mixture.means_[k], low, high)
        box_low, box_high, gap = largest_box(centre, bad, low, high, time_limit_s=time_limit_s)
        inside = ((flat >= box_low) & (flat <= box_high)).all(axis=1)
        chosen = points[inside & (belongs[:, k] > threshold)]
        fitted = Envelope(low=box_low.reshape(-1, 6), high=box_high.reshape(-1, 6))
        envelopes.append(Envelope.around(chosen) if len(chosen) else fitted)
        gaps.append(gap)
    return MixtureFit(
        envelopes=tuple(envelopes), shares=_shares(envelopes, points), gaps=tuple(gaps)
    )


def fit_improved(
    points: Array,
    boundary_fit: Callable[[Envelope, NDArray[np.intp]], Envelope],
    *,
    clusters: int = 1,
    threshold: float = 0.01,
    share: float = 0.05,
    seed: int = 0,
) -> MixtureFit:
    """Algorithm E2 with Boundary_fit asking what P1 answers instead of which points lie in the box.

    A point of P̄ outside the box does not keep P1 from finding another one inside, and the width of
    a box says nothing of the solutions it keeps. So each cluster starts from the quantile box of
    its own members, and ``boundary_fit`` moves the bounds by P1's margins over the training
    problems (``gradient.descend``); it is given the box and the members' indices in S.
    """
    flat = points.reshape(len(points), -1)
    mixture = mixture_of(flat, clusters, seed)
    belongs, labels = _membership(mixture, flat), mixture.predict(flat)
    envelopes = []
    for k in range(clusters):
        members = np.flatnonzero((labels == k) & (belongs[:, k] > threshold))
        members = members if len(members) else np.flatnonzero(labels == k)
        envelopes.append(boundary_fit(quantile_box(points[members], share=share), members))
    return MixtureFit(envelopes=tuple(envelopes), shares=_shares(envelopes, points))


def _membership(mixture: GaussianMixture, points: Array) -> Array:
    """Probability that a point belongs to each component, shape (K, clusters).

    With one component the posterior is 1 everywhere and would filter nothing, so it is weighted
    with the chance that a member of the component lies at least as far from its mean (Mahalanobis
    distance, χ² with D degrees of freedom).
    """
    tails = []
    for mean, root in zip(mixture.means_, mixture.precisions_cholesky_, strict=True):
        tails.append(chi2.sf(np.sum(((points - mean) @ root) ** 2, axis=1), points.shape[1]))
    return np.asarray(mixture.predict_proba(points) * np.stack(tails, axis=1))


def mixture_of(flat: Array, clusters: int, seed: int) -> GaussianMixture:
    """A mixture of so many Gaussians, fitted to points of shape (K, D)."""
    if clusters > len(flat):
        raise InvalidInput(
            f"clusters: expected at most {len(flat)}, one for each solution, got {clusters}"
        )
    return GaussianMixture(clusters, covariance_type="full", reg_covar=1e-5, random_state=seed).fit(
        flat
    )


def _shares(envelopes: list[Envelope], points: Array) -> tuple[float, ...]:
    return tuple(float(envelope.contains(points).mean()) for envelope in envelopes)


_MODES = {"ground": "ground", "wall": "wall", "terrain": "ground"}
"""Name of a mode over the scenes of each law."""


def modes_of(datasets: Sequence[Dataset], *, share: float = 0.0) -> Modes:
    """A mode a data set, in their order: the quantile box around S of Algorithm E1, the forces in
    world axes.

    The modes are named after the terrains of the distributions, or after these where they do not
    say theirs.

    Arguments:
        share: of the points left out on each side of each dimension; with none a box is the
            exterior boundary of Algorithm E2.

    Raises:
        InvalidInput: for fewer than two data sets, for different limbs, and for one without
            feasible rows.
    """
    if len(datasets) < 2:
        raise InvalidInput(f"data sets: expected two or more, one a mode, got {len(datasets)}")
    samples = dict[str, tuple[Sequence[Problem], Sequence[Envelope]]]()
    for rows in datasets:
        name, legs, first = rows.problem_class, rows.header.legs, datasets[0].header.legs
        if legs != first:
            raise InvalidInput(
                f"data sets: expected all on {', '.join(first)}, got {name} on {', '.join(legs)}"
            )
        problems = list(rows.select(rows.feasible).problems())
        if not problems:
            raise InvalidInput(f"data sets: expected feasible rows of {name}, got none")
        law = LAW.fullmatch(rows.header.plan.distribution)
        terrain = _MODES[law[1]] if law else getattr(distribution(name), "terrain", name)
        if terrain in samples:
            raise InvalidInput(f"data sets: expected one a terrain, got two of {terrain}")
        samples[terrain] = (
            problems,
            [quantile_box(world_points(problems, rows.points), share=share)],
        )
    return Modes.around(samples)


def solved_postures(
    name: str, count: int, planner: Exact, rng: np.random.Generator
) -> tuple[list[Problem], Array]:
    """Feasible problems of a distribution as they come, and the point [p, f] of a witness each,
    shape (K, N, 6).
    """
    source = distribution(name)
    problems, points = list[Problem](), list[Array]()
    while len(points) < count:
        problem = source.sample(rng)
        posture = planner.solve(problem).solution
        if posture is not None:
            problems.append(problem)
            points.append(Scaled.of(problem).point(posture))
    return problems, np.array(points)
