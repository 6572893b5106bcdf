"""A Gymnasium environment
=======================

Two seconds of random velocities at the tool: it rarely ends well. Prints the reward and how the episode
ended; `docs/learning.md` says what is seen and done. Needs the extra ``gym``.
"""

import gymnasium

env = gymnasium.make("polish_sim.envs:PolishForce-v1", action="twist", rate_hz=125, time_limit_s=2.0)
env.reset(seed=0)
env.action_space.seed(0)
total, over = 0.0, False
while not over:
    observation, reward, terminated, truncated, info = env.step(0.3 * env.action_space.sample())
    total, over = total + reward, terminated or truncated
print(f"observation of {len(observation)} numbers, exact force {info['privileged']['normal_force_n']:.1f} N")
print(f"reward {total:.1f}; " + (f"stopped: {info['stop_reason']}" if terminated else "its time was over"))
