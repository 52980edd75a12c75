"""An arm that a person pushes."""

import pytest

from stiction_envs.envs.render.push_view import PushView
from stiction_envs.experiments.sje.push import Push
from stiction_envs.friction.sticking import sticking_model
from stiction_envs.measured import AmplitudeRow


@pytest.fixture
def view():
    return PushView(Push(sticking_model("panda"), dither=[AmplitudeRow(7, 15.0, 0.8)]))
