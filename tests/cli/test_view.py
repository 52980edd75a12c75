"""``stiction view`` where there is no window, and which dither it takes."""

import json

import numpy as np

from stiction_envs.cli import view
from stiction_envs.dither.tables import HERE
from stiction_envs.envs.render import push_window, window
from stiction_envs.friction.sticking import sticking_model


def test_without_a_display_it_is_one_clear_line(refused, monkeypatch):
    monkeypatch.setattr(window, "has_display", lambda: False)
    assert refused("view", "panda", "--joint", 7) == (
        'error: view: no display found: render_mode="rgb_array" of an environment needs none'
    )


class Face:
    """A window that is closed after a tenth of a second."""

    def __init__(self, controls):
        self.controls = Face.last = controls

    def run(self, say):
        self.controls.advance(0.1)
        say("a line")

    def close(self):
        Face.closed = True


def test_what_was_asked_for_reaches_the_window(cli, dither, monkeypatch):
    monkeypatch.setattr(window, "has_display", lambda: True)
    monkeypatch.setattr(push_window, "PushWindow", Face)
    options = ["--joint", 7, "--dither", dither, "--payload", 2, 0, 0, 0.1, "--json"]
    ran = cli("view", "panda", *options)
    assert ran.code == 0
    assert json.loads(ran.out) == {"command": "view", "robot": "panda", "simulated_s": 0.1}
    assert ran.lines[-1] == "a line"
    push = Face.last.push
    assert push.joint == 7
    assert {j: (r.frequency_hz, r.amplitude_nm) for j, r in push.rows.items()} == {7: (15.0, 0.6)}
    assert Face.closed
    assert push.dither_seed == 0
    loaded = push.plant.load[1]
    cli("view", "panda", "--seed", 3)
    assert Face.last.push.dither_seed == 3
    assert Face.last.push.plant.load[1][0, 1] < loaded[0, 1]


def test_an_arm_without_a_table_gets_what_is_known_of_it(two):
    lines = (HERE / "iiwa7.csv").read_text().splitlines()[1:]
    iiwa = view.usual_dither(sticking_model("iiwa7"))
    assert [r.amplitude_nm for r in iiwa] == [float(x.split(",")[2]) for x in lines]
    own = sticking_model(str(two))
    rows = view.usual_dither(own)
    assert [r.joint for r in rows] == [1, 2]
    amplitudes = np.array([r.amplitude_nm for r in rows])
    stiction = own.parameters.stiction_at(own.parameters.load_low).mean(axis=-1)
    assert (amplitudes > 0).all()
    assert (amplitudes <= 1.5 * stiction + 1e-12).all()
