"""The Single Joint Experiment as a Gymnasium environment, alone and as a native batch."""

from stiction_envs.envs.gym_env import ArmEnv, ArmVectorEnv
from stiction_envs.envs.render.frames import JointRenderer
from stiction_envs.experiments.sje.episodes import SJEEpisodes


class SJEEnv(ArmEnv):
    """Break a sticking joint free with as little torque as possible, by dithering the arm.

    ## Description
    The Single Joint Experiment (thesis 3.2): the arm rests in a pose, one joint is free, and the
    torque commanded on it grows by 0.07 N·m/s until the joint has turned by 0.15 rad. The torque at
    that moment is τ_SJE; without dither it is τ_base. Dither – a sine on the commanded torque of
    any joint – lets the joint break away earlier. An episode is one ramp of one configuration: a
    joint, its load or no-load pose, and a direction. Every step sets the dither of all joints for
    the next `control_interval_s`; phases stay continuous. The numbers of the protocol are in
    `stiction_envs/experiments/sje/sje.toml`.

        import gymnasium as gym

        env = gym.make("stiction_envs:PandaSJE-v0")
        observation, info = env.reset(seed=1, options={"joint": 7, "load": "no_load"})

    `gym.make_vec("stiction_envs:PandaSJE-v0", num_envs=64)` steps 64 arms in one batch
    (`SJEVectorEnv`); row i of a batch is a single environment reset with seed + i, bit for bit.

    ## Action space
    [action space]

    ## Observation space
    `Box`, shape (6n + 5,), float32, clipped to its bounds. `env.unwrapped.observation_names` has
    the name of every element. The threshold is 0.15 rad; stiction is that of the action bounds. The
    torque of the tested joint is the ramp; the torques of the other joints hold these joints. After
    a reset, amplitude and frequency are −1.

    [observation table]

    ## Rewards
    Terms, in `info["reward_terms"]`; the reward is their sum. Δ is the change within the step.

    * `breakaway`: 1 when the joint breaks away, else 0.
    * `torque`: −Δ|τ| / |τ_base|, τ the commanded torque without dither, 0 before the first step.
    * `power`: −`power_weight` · s · mean over joints of (A / A_max)².
    * `torque_rate`: −`torque_rate_weight` · s · mean over joints of (2πfA / torque rate limit)²;
      0 where the robot has no such limit.
    * `shaking`: −`shaking_weight` · s · (oscillation / threshold)², the oscillation of this step:
      above 3 Hz, root mean square [rad], angles of all joints added as a vector, until the tested
      joint has moved by a fifth of the threshold.

    s = `control_interval_s` · 0.07 N·m/s / |τ_base| is the step's share of an undithered ramp. A
    weight is the cost of full dither over such a ramp, in units of torque reduction. The rewards of
    an episode that ends by breakaway sum to 1 − |τ_SJE| / |τ_base| minus the penalties.
    τ_base is computed without dither and scatter on the same model, once per process.

    ## Start and end of an episode
    A reset puts the arm near the pose, moves it to the pose as between two repeats, waits until the
    arm rests, and starts the ramp: at zero torque on the Panda, at the averaged external torque on
    the iiwa. With `scatter` the pose, the friction, the phases of the dither and the torque
    readings vary with the seed.

    * Terminated: the joint has turned by the threshold.
    * Truncated: the joint is given up as stuck (`give_up_factor` of the protocol), or
      `max_episode_steps` are over. There is no `breakaway` reward then.

    ## Info
    `joint` (1 … n), `load` and `direction` always; `torque` [N·m], `displacement` [rad], `time`
    [s], `vibration` (the oscillation of this step, [rad]) and `reward_terms` after a step; after
    the last step also `shaking` (the oscillation of the whole ramp, [rad]), `tau_sje`, `tau_base`
    (both signed, N·m) and `reduction` = 1 − |τ_SJE| / |τ_base|. Truncated: `tau_sje` and
    `reduction` are NaN.

    ## Options
    `env.reset(options={"joint": 1 … n, "load": "load" | "no_load", "direction": "+" | "-"})`;
    missing options are drawn from the seed.

    ## Arguments
    [arguments of the arm]
    * `scatter`: whether episodes of a configuration differ. Default True.
    * `control_interval_s`: time of a step, a multiple of 0.05 s. Default 0.1 s.
    * `power_weight`, `torque_rate_weight`: weights of the penalties [-]. Default 0.01 each.
    * `shaking_weight`: likewise [-]. Default 100000: 0.47 mrad all along would cost the whole
      torque. Without it the largest amplitude is best, often at the lowest frequency; with it the
      best frequency is inside the bounds on all joints of the Panda and the iiwa 7.
    * `max_episode_steps`: default 1000; `gym.make` gives it to a `TimeLimit`, which only shortens.
    [arguments of the episodes]
    * `render_mode`: `human` or `rgb_array` (the arm, the joint under test and its threshold;
      480 × 480 × 3).

    ## Version history
    * v0: first version.
    """

    episodes = SJEEpisodes
    renderer = JointRenderer


class SJEVectorEnv(ArmVectorEnv):
    """N arms of `SJEEnv`, stepped in one batch; see `ArmVectorEnv`."""

    episodes = SJEEpisodes
    renderer = JointRenderer
