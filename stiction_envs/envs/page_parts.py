"""The parts of an environment's page, its class docstring, that all experiments share."""

import inspect

from stiction_envs.experiments.episodes import Episodes
from stiction_envs.experiments.observation import (
    HIGHEST_FREQUENCY,
    LOWEST_FREQUENCY,
    STICTION_FACTOR,
)
from stiction_envs.reporting.markdown import table_text

_STRONGEST = f"A_max = min(torque limit, {STICTION_FACTOR:g} × stiction)"
_FASTEST = f"min({HIGHEST_FREQUENCY:g}, controller rate / 2)"
ACTION_TABLE = table_text(
    ["index", "meaning", "min", "max", "unit"],
    [
        ["0–6", "amplitude, joint 1 … 7", "0", _STRONGEST, "N·m"],
        ["7–13", "frequency, joint 1 … 7", f"{LOWEST_FREQUENCY:g}", _FASTEST, "Hz"],
    ],
)
SHARED = {
    "action space": f"""\
`Box`, shape (2n,), float32, for an arm of n joints (n = 7 below):

{ACTION_TABLE}

The stiction is the joint's largest over both poses and directions of the Single Joint Experiment.
Amplitude 0 is exactly no dither at every frequency. An action outside the space, or not a
number, is an error; wrap the environment in `gymnasium.wrappers.RescaleAction(env, -1, 1)` for
actions in [-1, 1].""",
    "arguments of the arm": """\
* `robot`: name of an arm in `robots.ARMS` (default: the environment's arm), or a path to an MJCF
  or URDF with 1 to 9 joints.
* `payload`: mass [kg] and centre of mass x, y, z [m] in the flange frame. Default none.
* `tilt`: roll and pitch of the base [rad]. Default (0, 0).
* `chain`: links at the base and the tip of the arm in a file of a bigger robot. Default: none.
* `friction`: path to a TOML, or `FrictionParameters`. Default: the robot's own.
* `sensing`: errors of measured angles and speeds, and delays: `"ideal"`, `"robot"` (the senses of
  the arm's TOML), the path of a TOML with a table `[sensing]`, or a `Sensing`. Rewards and measures
  use the true arm. Default `"ideal"`.""",
    "arguments of the episodes": """\
* `fixed_options`: reset options of all episodes; options of a single reset replace these.
* `randomise`: spreads, such as `{"friction": 0.2, "rotor": 0.2, "bristles": 0.3, "load": 0.5}`:
  in every episode dry friction, rotor inertia, bristle stiffness and load coefficient of each
  joint are the nominal arm's times a factor drawn uniformly from 1 ± spread. Units of
  observation and reward, bounds and controller remain the nominal arm's. Default none.
* `friction_factor`: stiction and load coefficient of the simulated arm over the nominal ones;
  units, bounds and controller remain the nominal arm's, as with `randomise`. Default 1.
* `waveform`: shape of the dither, one of `dither.waveforms.WAVEFORMS`. Default `sine`.
* `threads`: number of threads, 0 for all processors. Default 0.""",
}
"""Parts of a page by the line that stands for each, ``[action space]``."""


def observation_table(n: int, episodes: type[Episodes]) -> str:
    """Return the Markdown table of the observation for an arm of ``n`` joints."""
    rows, at = [], 0
    for g in episodes.groups:
        names = g.names(n)
        many = len(names) > 1
        index = f"{at}–{at + len(names) - 1}" if many else f"{at}"
        name = f"{names[0]} … {names[-1]}" if many else names[0]
        rows.append([index, name, f"{g.low:g}", f"{g.high:g}", g.unit, g.meaning])
        at += len(names)
    return table_text(["index", "name", "min", "max", "unit", "meaning"], rows)


def whole_page(page: str, episodes: type[Episodes]) -> str:
    """Return a page with its shared parts and its table of the observation, for seven joints."""
    out = inspect.cleandoc(page)
    for name, text in {**SHARED, "observation table": observation_table(7, episodes)}.items():
        out = out.replace(f"[{name}]", text.rstrip())
    return out
