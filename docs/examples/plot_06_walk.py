"""A walk over curved ground
=========================

A trot of ANYmal over ripples: torso, feet and forces over time, judged between the optimiser's
knots.
"""

import stancekit

answer = stancekit.walk("ripple", (1.0, 0.0), robot="anymal", duration_s=4.0)
print(answer.status.value, "-", answer.report.message)

# %%
# The walk is dense: a sample every 5 ms, feet in the robot's order.

walk = answer.solution
print(walk.samples, "samples of", ", ".join(foot.name for foot in walk.robot.feet))
for name in ("force_balance", "cone", "slip", "joint_speed", "torque"):
    group = answer.report.group(name)
    print(f"{name:14} {group.value:.3g} of {group.limit:.3g} {group.unit}")

# %%
_ = stancekit.draw(walk, caption="a trot over ripples", out="walk.png")
