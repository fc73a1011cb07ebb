"""Algorithm E2 (EnvelopeFitting): envelopes around the clusters of a mixture, as printed and
improved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2
from sklearn.mixture import GaussianMixture

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.relaxation.envelope import Envelope

from .boundary import largest_box
from .quantile import quantile_box

DOMAIN = 1.0
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
    it. Line 6: those that belong to the cluster with a probability above p_th (``membership``).
    Line 7: their exterior boundary; where lines 5 and 6 leave no point, the fitted box itself.

    Arguments:
        points: S, shape (K, N, 6).
        excluded: S̄, shape (J, N, 6).
        threshold: p_th.
    """
    flat, bad = points.reshape(len(points), -1), excluded.reshape(len(excluded), -1)
    mixture = _mixture(flat, clusters, seed)
    belongs = membership(mixture, flat)
    low, high = np.full(flat.shape[1], -DOMAIN), np.full(flat.shape[1], DOMAIN)
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
    mixture = _mixture(flat, clusters, seed)
    belongs, labels = membership(mixture, flat), mixture.predict(flat)
    envelopes = []
    for k in range(clusters):
        members = np.flatnonzero((labels == k) & (belongs[:, k] > threshold))
        members = members if len(members) else np.flatnonzero(labels == k)
        envelopes.append(boundary_fit(quantile_box(points[members], share=share), members))
    return MixtureFit(envelopes=tuple(envelopes), shares=_shares(envelopes, points))


def membership(mixture: GaussianMixture, points: Array) -> Array:
    """Probability that a point belongs to each component, shape (K, clusters).

    With one component the posterior is 1 everywhere and would filter nothing, so it is weighted
    with the chance that a member of the component lies at least as far from its mean (Mahalanobis
    distance, χ² with D degrees of freedom).
    """
    tails = []
    for mean, root in zip(mixture.means_, mixture.precisions_cholesky_, strict=True):
        tails.append(chi2.sf(np.sum(((points - mean) @ root) ** 2, axis=1), points.shape[1]))
    return np.asarray(mixture.predict_proba(points) * np.stack(tails, axis=1))


def _mixture(flat: Array, clusters: int, seed: int) -> GaussianMixture:
    if clusters > len(flat):
        raise InvalidInput(
            f"clusters: expected at most {len(flat)}, one for each solution, got {clusters}"
        )
    return GaussianMixture(clusters, covariance_type="full", reg_covar=1e-5, random_state=seed).fit(
        flat
    )


def _shares(envelopes: list[Envelope], points: Array) -> tuple[float, ...]:
    return tuple(float(envelope.contains(points).mean()) for envelope in envelopes)
