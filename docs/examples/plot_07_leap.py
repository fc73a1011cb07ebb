"""A leap
======

Stance, flight, stance: which patches, where the toes are on them, and with what every leg pushes.
"""

import numpy as np

import stancekit

answer = stancekit.plan("leap-given:0")
leap = answer.solution
print(answer.status.value, "-", stancekit.verify(leap).message)

# %%
# In the air the body follows a parabola; its highest point lies between the ends of the flight.

print("height of the body [m]", leap.com_m[:, 2].round(3))
print("greatest speed", np.linalg.norm(leap.velocity_m_s, axis=1).max().round(2), "m/s")

# %%
_ = stancekit.draw(leap, caption="from stance to stance", out="leap.png")
