"""Train a small policy by the cross-entropy method
================================================

Two to three minutes of processor, numpy only. Writes ``policy.npz``, prints its scorecard beside that of
``hybrid-pi`` alone.
"""

from pathlib import Path

import gymnasium
import numpy as np

from polish_sim.envs.policy import evaluate, linear, save_linear

PARALLEL, POPULATION, ELITE, GENERATIONS = 16, 48, 10, 40
RANGES = {
    "sensor.force_noise_n": (0.2, 0.8),
    "pad.stiffness_n_m": (15000.0, 30000.0),
    "robot.command_latency_s": (0.004, 0.012),
    "part.displacement_m": (0.0, 0.002),
}
LOOKS_AT = [2, 6, 7, 8, 11, 17, 23, 28, -1]
"""Along tool z: force, its error, set force, contact, height error, speed, planned speed, the last action;
and 1."""
SETTINGS = ("process.hold_s=1.5",)
KIND = {"action": "force-and-feed", "rate_hz": 125}


def rewards_of(envs: gymnasium.vector.VectorEnv, weights: np.ndarray, seed: int) -> np.ndarray:
    """Reward of one and the same episode with each of some weights, shape (n, actions, observation + 1)."""
    seen, _ = envs.reset(seed=[seed] * len(weights))
    total, running = np.zeros(len(weights)), np.ones(len(weights), bool)
    while running.any():
        actions = np.einsum("nij,nj->ni", weights[:, :, :-1], seen) + weights[:, :, -1]
        seen, reward, terminated, truncated, _ = envs.step(np.clip(actions, -1.0, 1.0).astype(np.float32))
        total += running * reward
        running &= ~(terminated | truncated)
    return total


def train(seed: int = 0) -> np.ndarray:
    """Weights of the policy clip(W (observation, 1)); the force is its to change, the tilt stays as
    planned."""
    envs = gymnasium.make_vec(
        "PolishForce-v1", PARALLEL, "sync", ranges=RANGES, bodies=4, settings=SETTINGS, **KIND
    )
    shape = (envs.single_action_space.shape[0], envs.single_observation_space.shape[0] + 1)
    rng, mean, spread = np.random.default_rng(seed), np.zeros(len(LOOKS_AT)), np.full(len(LOOKS_AT), 0.05)
    for generation in range(GENERATIONS):
        rows = mean + spread * rng.standard_normal((POPULATION, len(LOOKS_AT)))
        rows[0] = mean
        weights = np.zeros((POPULATION, *shape))
        weights[:, 0, LOOKS_AT] = rows
        reward = np.zeros(POPULATION)
        for first in range(0, POPULATION, PARALLEL):
            reward[first : first + PARALLEL] = rewards_of(
                envs, weights[first : first + PARALLEL], 1000 + generation
            )
        best = rows[np.argsort(reward)[-ELITE:]]
        mean, spread = best.mean(axis=0), best.std(axis=0) + 0.002
        print(
            f"generation {generation + 1:2d}: reward {reward.mean():6.1f}, best {reward.max():6.1f}",
            flush=True,
        )
    envs.close()
    trained = np.zeros(shape)
    trained[0, LOOKS_AT] = mean
    return trained


if __name__ == "__main__":
    weights = train()
    env = gymnasium.make("PolishForce-v1", **KIND)
    save_linear(Path("policy.npz"), weights, env)
    print("held-out seeds        settling [s]  overshoot [N]  RMS [N]  success  reward")
    for name, W in (("hybrid-pi", np.zeros_like(weights)), ("trained", weights)):
        rows = evaluate(env, linear(W), 10, seed=10**6)
        keys = ("settling_1n_s", "overshoot_n", "rms_error_n", "success", "reward")
        figures = [np.mean([np.nan if row[key] is None else row[key] for row in rows]) for key in keys]
        print("{:20s} {:12.3f} {:14.2f} {:8.3f} {:8.0%} {:7.1f}".format(name, *figures))
    print("scored like any controller: polish-sim score --controller policy.npz:linear --against hybrid-pi")
