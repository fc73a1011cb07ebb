"""A climb between two walls
=========================

A hexapod braced between upright walls: where every toe goes, with what it presses, and how much the
stances bear.
"""

import stancekit

answer = stancekit.plan("walls")
print(answer.status.value, "with", answer.solution.problem.frames, "key frames")
print(answer.report.message)

# %%
# What every stance bears beyond the weight, and how much of the friction is spare.

print(stancekit.verify(answer.solution, margins=True).remark)

# %%
# Each foothold says which limb stands there, and from which key frame on.

for foothold, toe in zip(answer.problem.footholds[:6], answer.solution.toes_m, strict=False):
    print(foothold.limb, "from frame", foothold.frame, "at", toe.round(3))

# %%
_ = stancekit.draw(answer.solution, caption="forces on two walls", out="climb.png")
