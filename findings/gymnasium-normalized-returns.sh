#!/bin/sh
# NormalizeReward of gymnasium's vector environments, by whose running return rewards are scaled, where
# episodes end.
#
# Seen with gymnasium 1.4.0, episodes of three rewards of 1, gamma = 1: under SAME_STEP the return is 1, 2, 0
# and begins anew; under NEXT_STEP, which is the default, it is 1, 2, 1, then 1, 2, 3, 1, then 1, 2, 3, 1: the
# third reward is taken for the first of a return that goes on into the next episode.
#
# Guess beforehand: a return begins with its episode, so that it is 1, 2, 3 in every episode under both.
# What seems to happen: the return is multiplied by 1 - terminated before the reward is added, so that the
# last reward of an episode alone is left over, and the reset that follows in its own step, with a reward of
# 0, keeps it.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "gymnasium==1.4.0" "numpy==2.4.6"
cat > returns.py <<'PYTHON'
import sys

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv


class Three(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
    action_space = gymnasium.spaces.Discrete(2)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.left = 3
        return np.zeros(1, np.float32), {}

    def step(self, action):
        self.left -= 1
        return np.zeros(1, np.float32), 1.0, self.left == 0, False, {}


def returns(mode, steps):
    envs = SyncVectorEnv([Three], autoreset_mode=mode)
    scaled, found = gymnasium.wrappers.vector.NormalizeReward(envs, gamma=1.0), []
    scaled.reset(seed=0)
    for _ in range(steps):
        scaled.step(np.array([0]))
        found.append(float(scaled.accumulated_reward[0]))
    return found


print(f"gymnasium {gymnasium.__version__}")
same, later = returns(AutoresetMode.SAME_STEP, 6), returns(AutoresetMode.NEXT_STEP, 11)
print(f"SAME_STEP: {same}\nNEXT_STEP: {later}")
sys.exit(same != [1, 2, 0, 1, 2, 0] or later != [1, 2, 1, 1, 2, 3, 1, 1, 2, 3, 1])
PYTHON
env/bin/python returns.py
