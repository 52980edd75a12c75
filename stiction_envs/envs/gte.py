"""The Generated Trajectory Experiment as a Gymnasium environment, alone and as a native batch."""

from stiction_envs.envs.gym_env import ArmEnv, ArmVectorEnv
from stiction_envs.envs.render.frames import PathRenderer
from stiction_envs.experiments.gte.episodes import GTEEpisodes


class GTEEnv(ArmEnv):
    """Follow a path with a sticking arm as closely as possible, by dithering it.

    ## Description
    The Generated Trajectory Experiment (thesis 3.2, 4.2): an arm under Cartesian impedance control
    follows straight lines from goal to goal: a triangle in space, a pentagon in a plane, or one of
    many random paths, so that a policy cannot memorise a path. Its
    joints stick, so the hand lags behind the reference and stops short of the corners. Dither – a
    sine on the commanded torque of any joint – frees the joints, and shakes the arm. An episode is
    one run along the path. Every step sets the dither of all joints for the next
    `control_interval_s`, so that it can come and go with the motion; phases stay continuous. The
    numbers of the experiment are in `stiction_envs/experiments/gte/gte.toml` and
    `stiction_envs/control/gte.toml`.

        import gymnasium as gym

        env = gym.make("stiction_envs:PandaGTE-v0")
        observation, info = env.reset(seed=1, options={"trajectory": "triangle"})

    `gym.make_vec("stiction_envs:PandaGTE-v0", num_envs=64)` steps 64 arms in one batch
    (`GTEVectorEnv`); row i of a batch is a single environment reset with seed + i, bit for bit.
    A constant action is one case of `stiction gte`: with the option `iteration` k the episode is
    its iteration k, bit for bit.

    ## Action space
    [action space]

    ## Observation space
    `Box`, shape (5n + 20,), float32, clipped to its bounds. `env.unwrapped.observation_names` has
    the name of every element. The tolerance, within which a goal counts as reached, is 0.04 m and
    0.25 rad, v_max is 0.5 m/s, ω_max 0.5 rad/s. The torque is that of controller and
    compensation in their last cycle, before the limits; its unit is the nominal arm's stiction at
    the start. After a reset, amplitude and frequency are −1. The nullspace stiffness (default 0) is
    not observed. Only the next two goals of the path are observed, relative to the tool point, so
    a policy can follow paths that were not in its training.

    [observation table]

    ## Rewards
    Terms, in `info["reward_terms"]`; the reward is their sum.

    * `settling`: −w · ½ (distance / D + angle / A) / goals, paid when the arm leaves a goal:
      distance [m] and angle [rad] are the pose error in the last sample before the next goal is
      accepted; at the last goal, 1 s (`tail`) after the arm reached it. D and A are the distance
      and angle of undithered runs at that goal. w is `settling_weight`.
    * `tracking`: −(1 − w) · mean over the axes x, y, z, roll, pitch, yaw of Σ|e| / E. e is the pose
      minus the reference, 100 samples/s from the start until 1 s (`tail`) after the last goal was
      reached; E is the same sum over a whole undithered run.
    * `power`: −`power_weight` · s · mean over joints of (A / A_max)².
    * `torque_rate`: −`torque_rate_weight` · s · mean over joints of (2πfA / torque rate limit)²;
      0 where the robot has no such limit.
    * `shaking`: −`shaking_weight` · s · (vibration / 1 mm), the vibration of this step as in the
      info.

    s = `control_interval_s` / duration of the undithered run is the step's share of this run. A
    weight is the cost of full dither, or of 1 mm of shaking, over the whole run, in units of the
    undithered error.
    The rewards of an episode sum to −w · (error left) − (1 − w) · (tracking error) less the
    penalties: about −1 without dither, 0 for a perfect arm. D, A, E and the duration are means over
    the 10 undithered iterations that `stiction gte` would run for the same trajectory, stiffness,
    arm and friction; they are computed at the first reset that needs them, once per process, which
    takes some seconds.

    ## Start and end of an episode
    A reset brings the arm to the start against its friction, from one side; the controller takes
    over at this pose, and the first goal is accepted. With `scatter` the side, the pose, the
    friction and the phases of the dither vary with the seed.

    * Terminated: 1 s after the last goal was reached. (A goal also counts as reached 1 s after the
      reference came to rest there, so every episode ends.)
    * Truncated: `max_episode_steps` are over.

    ## Info
    `trajectory`, `path` (−1 if it has no number) and `stiffness` (3,) always; `time` [s],
    `goals_reached`, `vibration` (above 8 Hz in this step, root mean square [m]: of the tool point's
    position and, with a lever of 0.1 m, of the hand's turns) and `reward_terms` after a step; after
    the last step also

    * `error` (6,): |e| of x, y, z [m], roll, pitch, yaw [rad], summed over the 200 samples from 1 s
      before to 1 s after the last goal was accepted, as in Table 4.11; NaN if truncated before.
    * `undithered_error` (6,): the same without dither, mean over iterations.
    * `error_left` (2,): error of position [m] and orientation [rad] when the arm leaves a goal,
      mean over goals, and `resting_error` (2,), at the last goal only, where the arm rests;
      NaN if truncated before. `undithered_error_left`, `undithered_resting_error`: without dither.
    * `settling_error`, `tracking_error`: the sums of −`settling` and −`tracking` for weight 1:
      about 1 each without dither.
    * `shaking`: root mean square of the vibration over the motion [m], `undithered_shaking`, and
      `shaking_at_rest` after the last goal was reached.
    * `duration`: when the last goal was reached [s]; NaN if truncated before.

    ## Options
    `env.reset(options={"trajectory": "triangle", "stiffness": (200, 20, 0)})`. The trajectory is
    `"triangle"`, `"pentagon"` or `"random"`; stiffness is translational [N/m], rotational and
    nullspace [N·m/rad]. Missing options are drawn from the seed: triangle or pentagon, stiffness
    from (200, 20, 0) and (400, 40, 0).

    * `"path": k` is random path k, from 0; `"trajectory": "random"` without it draws one of numbers
      0 to `random_paths` − 1. Path k is always the same for an arm, its start and its tool: three
      to six goals in a flat box around the start, 0.16 to 0.4 m long and sloping by up to 45°, at
      0.6 to 1 of the speed, with a stiffness from (100, 10, 0) to (800, 80, 0) if no other is
      given. Lines near joint limits or singular poses are drawn anew. Test on numbers that are
      never drawn.
    * `"iteration": k` starts as iteration k (from 0) of `stiction gte --seed` `scatter_seed` does.

    ## Arguments
    [arguments of the arm]
    * `scatter`: whether the pose and side of the start, friction and phases vary with the seed.
      Default True.
    * `scatter_seed`: seed of numbered iterations and of the undithered runs. Default 0.
    * `settings`: `ImpedanceSettings` of the controller. Default: those of `stiction gte`.
    * `motion`: `MotionLimits` of the trajectory generator. Default likewise.
    * `start`: joint angles at the start [rad], one per joint. Default: the robot's rest pose.
    * `tool`: x, y, z of the point that is controlled and measured, from the flange in the hand's
      frame [m]; the Panda's hand has (0, 0, 0.1034). Default: the flange.
    * `compensation`: friction compensation, besides the dither: `"feedforward"` of the reference
      motion, `"push"` in the sign of the joint error, `"lugre_observer"` or
      `"momentum_observer"`, with gains of `friction`; a file of gains (`compensation.csv`,
      `final.yaml`); or a `Compensation`. Undithered runs are compensated too. Default none.
    * `controller_model`: the controller's model of the arm, an `Arm`, for a wrong payload or tilt.
      Default: the true arm.
    * `random_paths`: number of random paths to draw from. Default 64, whose undithered runs (4
      iterations each) are shipped for the builtin arms; for another arm the first reset computes
      these runs, which takes minutes.
    * `control_interval_s`: time of a step, a multiple of 0.02 s. Default 0.1 s.
    * `settling_weight`: w, 0 to 1. Default 0.75: friction decides where the arm stops, the
      impedance law how far it lags.
    * `power_weight`, `torque_rate_weight`, `shaking_weight`: weights of the penalties [-]. Default
      0.01 each.
    * `max_episode_steps`: default 400; `gym.make` gives it to a `TimeLimit`, which only shortens.
    [arguments of the episodes]
    * `render_mode`: `human` or `rgb_array` (the arm, the path, its goals and the reference;
      480 × 480 × 3).

    ## Version history
    * v0: first version.
    """

    episodes = GTEEpisodes
    renderer = PathRenderer


class GTEVectorEnv(ArmVectorEnv):
    """N arms of `GTEEnv`, stepped in one batch; see `ArmVectorEnv`."""

    episodes = GTEEpisodes
    renderer = PathRenderer
