"""Train a policy by PPO (stable-baselines3)
=========================================

More than five minutes of processor; needs the extra ``rl``, which brings torch. Writes ``policy.zip``, prints
its scorecard beside that of ``hybrid-pi``.
"""

import gymnasium
import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

from polish_sim.envs.policy import evaluate

KIND = {"action": "force-and-feed", "rate_hz": 125}
RANGES = {"sensor.force_noise_n": (0.2, 0.8), "pad.stiffness_n_m": (15000.0, 30000.0)}

if __name__ == "__main__":
    kwargs = {**KIND, "ranges": RANGES, "bodies": 2, "settings": ["process.hold_s=1.5"]}
    envs = make_vec_env("PolishForce-v1", n_envs=8, env_kwargs=kwargs)
    model = PPO(
        "MlpPolicy",
        envs,
        n_steps=512,
        batch_size=256,
        gamma=0.98,
        policy_kwargs={"log_std_init": -2.0},
        seed=0,
    )
    model.learn(100_000)
    model.save("policy.zip")
    env = gymnasium.make("PolishForce-v1", **KIND)
    policies = {
        "hybrid-pi": lambda _seen: np.zeros(env.action_space.shape, np.float32),
        "PPO": lambda seen: model.predict(seen, deterministic=True)[0],
    }
    for name, policy in policies.items():
        rows = evaluate(env, policy, 10, seed=10**6)
        overshoot, error = (np.mean([row[key] for row in rows]) for key in ("overshoot_n", "rms_error_n"))
        success = np.mean([row["success"] for row in rows])
        print(f"{name:10s} overshoot {overshoot:.2f} N, RMS error {error:.3f} N, success {success:.0%}")
    print("polish-sim score --controller policy.zip:sb3 --set controller.own.action=force-and-feed")
