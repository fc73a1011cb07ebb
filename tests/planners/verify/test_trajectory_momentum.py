"""Windows of impulse: the worst of all of them, whichever are looked at."""

from types import SimpleNamespace

import numpy as np
import pytest

from stancekit.planners.verify.trajectories import MomentumMeasurements
from stancekit.planners.verify.trajectory_measurements import Series


@pytest.mark.parametrize("rate", [0.0, 0.3, 2.0, 50.0])
@pytest.mark.parametrize("drift", [0.0, 0.5])
def test_the_worst_window_is_that_of_all_windows(rate, drift):
    rng, step_s, worst = np.random.default_rng(7), 0.01, list[float]()
    for count in (3, 40, 150):
        values = rng.normal(size=(count, 3)) + drift
        measured = SimpleNamespace(
            trajectory=None, times_s=np.arange(count + 2) * step_s, step_s=step_s
        )
        momentum = MomentumMeasurements(measured)
        found = momentum._windows(Series(values, ("x", "y", "z"), np.arange(count)), rate)
        sums = np.concatenate([np.zeros((1, 3)), np.cumsum(values, axis=0)]) * step_s
        apart = np.linalg.norm(sums[:, None] - sums[None], axis=-1)
        lasting = np.abs(np.subtract.outer(np.arange(count + 1), np.arange(count + 1))) * step_s
        assert found.values.item() == pytest.approx((apart - rate * lasting).max(), abs=1e-12)
        worst.append(found.values.item())
    assert max(worst) > 0.0 or rate == 50.0
