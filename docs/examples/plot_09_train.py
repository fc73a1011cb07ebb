"""Train an agent
==============

An environment of Gymnasium, an agent of stable-baselines3: boxes are cut until a posture is found,
or there is proved to be none. 32 steps learn nothing; they show that everything fits together.
"""

import gymnasium
import matplotlib.pyplot as plt
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

import stancekit.envs  # noqa: F401  registers the environments

env = make_vec_env(
    lambda: gymnasium.make("stancekit/EnvelopeRefinement-v0", problem="ground-3", budget=50),
    n_envs=2,
    seed=0,
)
agent = PPO("MultiInputPolicy", env, n_steps=16, batch_size=16, seed=0, device="cpu")
_ = agent.learn(32)

# %%
# What the agent does, step by step.

observation, rewards = env.reset(), []
for _ in range(5):
    action, _ = agent.predict(observation, deterministic=True)
    observation, reward, done, info = env.step(action)
    rewards.append(reward)
print([entry["verdict"] for entry in info])

# %%
figure, axes = plt.subplots(figsize=(6, 2.5), layout="constrained")
axes.plot(rewards, marker="o")
axes.set(xlabel="step", ylabel="reward")
figure.savefig("rewards.png", dpi=110)
