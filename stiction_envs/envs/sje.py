"""The Single Joint Experiment as a Gymnasium environment, alone and as a native batch."""

from __future__ import annotations

from stiction_envs.envs.gym_env import ArmEnv, ArmVectorEnv
from stiction_envs.envs.render.sje_frames import JointRenderer
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
    `Box`, shape (2n,), float32, for an arm of n joints (n = 7 below):

    | index | meaning | min | max | unit |
    |---|---|---|---|---|
    | 0–6 | amplitude, joint 1 … 7 | 0 | A_max = min(torque limit, 2.5 × stiction) | N·m |
    | 7–13 | frequency, joint 1 … 7 | 5 | min(100, controller rate / 2) | Hz |

    The stiction is the joint's largest, of both poses and directions. Amplitude 0 is exactly no
    dither, whatever the frequency. An action outside the space, or not a number, is an error; wrap
    the environment in `gymnasium.wrappers.RescaleAction(env, -1, 1)` for actions in [-1, 1].

    ## Observation space
    `Box`, shape (6n + 5,), float32, clipped to its bounds. `env.unwrapped.observation_names` has
    the name of every element. Threshold is 0.15 rad, the stiction that of the action's bounds. The
    tested joint's torque is the ramp's, the others' hold them. After a reset, amplitude and
    frequency are −1.

    | index | name | min | max | unit | meaning |
    |---|---|---|---|---|---|
    | 0–6 | displacement_1 … displacement_7 | -5 | 5 | threshold | link angle minus the pose |
    | 7–13 | velocity_1 … velocity_7 | -50 | 50 | threshold/s | link speed |
    | 14–20 | torque_1 … torque_7 | -50 | 50 | stiction | commanded torque, dither excluded |
    | 21 | progress | -5 | 5 | threshold | angle since the ramp started, along the ramp |
    | 22 | ramp | -10 | 10 | τ_base | commanded torque of the tested joint, dither excluded |
    | 23 | elapsed | 0 | 20 | τ_base | torque by which the ramp has grown |
    | 24–30 | tested_1 … tested_7 | 0 | 1 | 1 | 1 for the tested joint, else 0 |
    | 31 | load | 0 | 1 | 1 | 1 in the load pose, 0 in the no-load pose |
    | 32 | direction | -1 | 1 | 1 | sign of the ramp |
    | 33–39 | amplitude_1 … amplitude_7 | -1 | 1 | 1 | last amplitude; −1 is 0, +1 is A_max |
    | 40–46 | frequency_1 … frequency_7 | -1 | 1 | 1 | last frequency; −1 is f_min, +1 is f_max |

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

    s = `control_interval_s` · 0.07 N·m/s / |τ_base| is the step's share of an undithered ramp: a
    weight is what full dither would cost over such a ramp, in units of torque reduction. Over an
    episode that ends by breakaway the rewards sum to 1 − |τ_SJE| / |τ_base| less the penalties.
    τ_base is computed without dither and scatter on the same model, once per process.

    ## Start and end of an episode
    A reset puts the arm near the pose, moves it there as between two repeats, waits until it rests
    and starts the ramp: at zero torque on the Panda, at the averaged external torque on the iiwa.
    With `scatter` the pose, the friction, the phases of the dither and the torque readings vary
    with the seed.

    * Terminated: the joint has turned by the threshold.
    * Truncated: the joint is given up as stuck (`give_up_factor` of the protocol), or
      `max_episode_steps` are over. There is no `breakaway` reward then.

    ## Info
    `joint` (1 … n), `load` and `direction` always; `torque` [N·m], `displacement` [rad], `time`
    [s], `vibration` (the oscillation of this step, [rad]) and `reward_terms` after a step; after
    the last one also `shaking` (the oscillation of the whole ramp, [rad]), `tau_sje`, `tau_base`
    (both signed, N·m) and `reduction` = 1 − |τ_SJE| / |τ_base|. Truncated: `tau_sje` and
    `reduction` are NaN.

    ## Options
    `env.reset(options={"joint": 1 … n, "load": "load" | "no_load", "direction": "+" | "-"})`; what
    is not given is drawn from the seed.

    ## Arguments
    * `robot`: name of an arm (the environment's own by default; `robots.ARMS` has them all), or a
      path to an own MJCF or URDF with 1 to 9 joints.
    * `payload`: mass [kg] and centre of mass x, y, z [m] in the flange frame. Default none.
    * `tilt`: roll and pitch of the base [rad]. Default (0, 0).
    * `chain`: links at the base and the tip of the arm in a file of a bigger robot. Default: none.
    * `scatter`: whether episodes of a configuration differ. Default True.
    * `friction`: path to a TOML, or `FrictionParameters`. Default: the robot's own.
    * `sensing`: what controller and observation have of the arm: `"ideal"`, `"robot"` (the senses
      of the arm's TOML), the path of a TOML with a table `[sensing]`, or a `Sensing`. Rewards and
      measures are of the true arm. Default `"ideal"`.
    * `control_interval_s`: time of a step, a multiple of 0.05 s. Default 0.1 s.
    * `power_weight`, `torque_rate_weight`: weights of the penalties [-]. Default 0.01 each.
    * `shaking_weight`: likewise [-]. Default 100000: 0.47 mrad all along would cost the whole
      torque. Without it the largest amplitude is best, often at the lowest frequency; with it the
      best frequency is inside the bounds on all joints of the Panda and the iiwa 7.
    * `max_episode_steps`: default 1000; `gym.make` gives it to a `TimeLimit`, which only shortens.
    * `fixed_options`: reset options of all episodes; those of a single reset come before them.
    * `randomise`: spreads, such as `{"friction": 0.2, "rotor": 0.2, "bristles": 0.3, "load": 0.5}`:
      in every episode dry friction, rotor inertia, bristle stiffness and load coefficient of each
      joint are the nominal arm's times a factor drawn uniformly from 1 ± spread. Units of
      observation and reward, bounds and controller remain the nominal arm's. `"senses"` is the
      spread of one factor of noise and delays, where `sensing` is not ideal. Default none.
    * `friction_factor`: stiction and load coefficient of the simulated arm over the nominal ones;
      units, bounds and controller remain the nominal arm's, as with `randomise`. Default 1.
    * `waveform`: shape of the dither, one of `dither.waveforms.WAVEFORMS`. Default `sine`.
    * `threads`: threads, each with arms of its own, 0 for all processors. Default 0.
    * `render_mode`: `human`, `rgb_array` (scene, torque and displacement; 450 × 800 × 3) or
      `depth_array` (the scene only, metres, 450 × 460).

    ## Version history
    * v0: first version.
    """

    episodes = SJEEpisodes
    renderer = JointRenderer


class SJEVectorEnv(ArmVectorEnv):
    """N arms of `SJEEnv`, stepped in one batch; see `ArmVectorEnv`."""

    episodes = SJEEpisodes
    renderer = JointRenderer
