#!/bin/sh
# Returns of episodes that RLlib's SingleAgentEnvRunner samples from a batch of its own
# (gym_env_vectorize_mode="vector_entry_point"), by the mode in which the batch resets.
#
# Seen with ray 2.60.0, episodes of three rewards of 1, two environments: under NEXT_STEP every return is 3;
# under SAME_STEP the first two are 3 and all others are 2. Nothing is said.
#
# Guess beforehand: the runner reads the batch's autoreset_mode, which its metadata names, or refuses it.
# What seems to happen: the step after an episode's end is always taken for the reset of the next one, so
# that under SAME_STEP its action and reward are lost, and what follows it stands as the first observation.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "ray[rllib]==2.60.0" "numpy==2.4.6" "torch==2.13.0"
cat > returns.py <<'PYTHON'
import sys

import gymnasium
import numpy as np
import ray
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.env.single_agent_env_runner import SingleAgentEnvRunner


class Three(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(0.0, 9.0, (1,), np.float32)
    action_space = gymnasium.spaces.Discrete(2)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.left = 3
        return np.zeros(1, np.float32), {}

    def step(self, action):
        self.left -= 1
        return np.zeros(1, np.float32), 1.0, self.left == 0, False, {}


def returns(name, mode):
    def batch(num_envs, **keywords):
        return SyncVectorEnv([Three] * num_envs, autoreset_mode=mode)

    gymnasium.register(name, Three, vector_entry_point=batch)
    runners = {"num_envs_per_env_runner": 2, "gym_env_vectorize_mode": "vector_entry_point"}
    runner = SingleAgentEnvRunner(config=PPOConfig().environment(name).env_runners(**runners))
    episodes = runner.sample(num_episodes=6, random_actions=True)
    return [float(episode.get_return()) for episode in episodes]


print(f"ray {ray.__version__}, gymnasium {gymnasium.__version__}")
later, same = returns("Later-v0", AutoresetMode.NEXT_STEP), returns("Same-v0", AutoresetMode.SAME_STEP)
print(f"NEXT_STEP: {later}\nSAME_STEP: {same}")
sys.exit(later != [3] * 6 or same != [3, 3, 2, 2, 2, 2])
PYTHON
env/bin/python returns.py
