"""The speed of a computer, by cold solves of one cone program in which nothing is this package's
own.
"""

from __future__ import annotations

import time

import clarabel
import numpy as np
import scipy.sparse as sp

_SOLVES = 1000


def yardstick(solves: int = _SOLVES) -> float:
    """CPU time of cold solves of one cone program of a posture's size [s].

    Arguments:
        solves: number of solves, 10 to 1,000.
    """
    rng = np.random.default_rng(0)
    n, cones = 45, 24
    a = sp.csc_matrix(np.vstack([rng.normal(size=(6, n)), rng.normal(size=(3 * cones, n))]))
    b = np.asarray(a @ rng.normal(size=n))
    b[6::3] += 4.0
    kinds = [clarabel.ZeroConeT(6), *[clarabel.SecondOrderConeT(3)] * cones]
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.max_threads = False, 1
    hessian, q = sp.csc_matrix(np.eye(n)), rng.normal(size=n)
    begin = time.process_time()
    for _ in range(solves):
        clarabel.DefaultSolver(hessian, q, a, b, kinds, settings).solve()
    return time.process_time() - begin
