"""A selector of your own
======================

A selector chooses the box over positions and forces over which P1 relaxes the moments. Put one of
your own beside some that are learned, and roll all of them out on the same held-out scenes. Twenty
rows of each kind say which is better only as far as the intervals do.
"""

import matplotlib.pyplot as plt
import numpy as np

import stancekit
from stancekit.learners.selectors.selector import Learned

train = stancekit.label("wall-3", "train", rows=(20, 20))
test = stancekit.label("wall-3", "test", rows=(20, 20), seed=1)


class NarrowForces:
    """Forces near an equal share of the weight, positions anywhere."""

    problem_class = "wall-3"

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        """All lower, then all upper bounds, per contact p_x p_y p_z f_n f_y f_z,
        non-dimensional.
        """
        count = observation["friction"].shape[-1]
        bounds = [-1, -1, -1, -0.1, -0.6, -0.6], [1, 1, 1, 1.0, 0.6, 0.6]
        return np.concatenate([np.tile(side, count) for side in bounds]).astype(np.float32), state


# %%
# P1 should say *feasible* of the feasible scenes and *infeasible* of the others.

learned = {name: stancekit.fit(train, name) for name in ("heuristic", "quantile")}
learned["mine"] = Learned.of(NarrowForces(), "mine", "wall-3")
scores = {}
for name, selector in learned.items():
    scores[name] = score = stancekit.evaluate(selector, test, projections=("fix-p",), name=name)
    shares = (score.p1_feasible, score.p1_infeasible, score.projected["fix-p"])
    print(f"{name:10}", *(f"{share.value:>5.0%}" for share in shares))

# %%
# As a picture, with 95 % intervals.

figure, axes = plt.subplots(figsize=(7, 3.2), layout="constrained")
for index, kind in enumerate(("p1_feasible", "p1_infeasible")):
    shares = [getattr(score, kind) for score in scores.values()]
    places = np.arange(len(scores)) + 0.2 * (2 * index - 1)
    values = np.array([share.value for share in shares])
    low, high = np.array([share.interval for share in shares]).T
    bars = axes.bar(places, values, 0.38, yerr=[values - low, high - values], capsize=3)
    bars.set_label(kind.replace("_", " "))
axes.set_xticks(range(len(scores)), scores)
axes.set_ylabel("share that P1 answers right")
axes.legend(loc="lower right")
figure.savefig("selectors.png", dpi=110)
