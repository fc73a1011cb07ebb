"""
Train and compare selectors
===========================

A selector chooses the box over positions and forces over which P1 relaxes the moments. Learn some from labelled scenes,
put one of your own beside them, and roll all of them out on the same held-out scenes.
"""

# %%
# Data
# ----
# Every row is decided exactly: with a posture, or with a certificate. Forty rows are enough to see how it goes, and too
# few to say which selector is better: the intervals show it.

import numpy as np

import stancekit

train = stancekit.label("wall-3", "train", rows=(20, 20))
test = stancekit.label("wall-3", "test", rows=(20, 20), seed=1)
print(len(train), "rows of", train.problem_class, "and", len(test), "held out")

# %%
# Yours
# -----
# ``predict`` is that of a stable-baselines3 policy. The action is all lower and then all upper bounds, contact by
# contact the columns p_x p_y p_z f_n f_y f_z, non-dimensional.


class NarrowForces:
    """Forces near an equal share of the weight, positions anywhere."""

    problem_class = "wall-3"

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        """The same box for every scene."""
        count = observation["friction"].shape[-1]
        low, high = np.tile([-1, -1, -1, -0.1, -0.6, -0.6], count), np.tile([1, 1, 1, 1.0, 0.6, 0.6], count)
        return np.concatenate([low, high]).astype(np.float32), state


# %%
# Compare
# -------
# P1 should say *feasible* of the feasible scenes and *infeasible* of the others; P2 should get back from P1's point to
# a posture that the verifier accepts.

from stancekit.learners.selectors.selector import Learned

learned = {name: stancekit.fit(train, name) for name in ("heuristic", "quantile")}
learned["gradient"] = stancekit.fit(train, "gradient", steps=20, batch=30)
learned["mine"] = Learned.of(NarrowForces(), "mine", "wall-3")
scores = {name: stancekit.evaluate(one, test, projections=("fix-p", "scp"), name=name) for name, one in learned.items()}
print(f"{'selector':10} {'P1 feasible':>12} {'P1 infeasible':>14} {'fix-p':>8} {'scp':>8}")
for name, score in scores.items():
    shares = [score.p1_feasible, score.p1_infeasible, score.projected["fix-p"], score.projected["scp"]]
    print(f"{name:10} " + " ".join(f"{share.value:>{w}.0%}" for share, w in zip(shares, (12, 14, 8, 8), strict=True)))

# %%
# As a picture, with 95 % intervals
# ---------------------------------

import matplotlib.pyplot as plt

figure, axes = plt.subplots(figsize=(7, 3.2), layout="constrained")
for index, (kind, colour) in enumerate((("p1_feasible", "tab:blue"), ("p1_infeasible", "tab:orange"))):
    found = [getattr(score, kind) for score in scores.values()]
    places = np.arange(len(scores)) + 0.2 * (2 * index - 1)
    values = np.array([share.value for share in found])
    low, high = np.array([share.interval for share in found]).T
    axes.bar(places, values, 0.38, color=colour, label=kind.replace("_", " "))
    axes.errorbar(places, values, [values - low, high - values], fmt="none", ecolor="black", capsize=3)
axes.set_xticks(range(len(scores)), scores)
axes.set_ylabel("share that P1 answers right")
axes.set_ylim(0, 1.05)
axes.legend(loc="lower right")
figure.savefig("selectors.png", dpi=110)
