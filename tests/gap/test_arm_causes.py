"""One thing before many: what a wide cause makes needless goes, where that is shorter to say."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.gap.causes import CAUSES
from stiction_envs.gap.causes.body.bodies import with_link
from stiction_envs.gap.diagnosis import diagnose_logs
from stiction_envs.gap.selection.candidates import Candidate, RegressorLibrary
from stiction_envs.gap.selection.chooser import Chooser
from stiction_envs.gap.selection.whole_models import description_length, prefer_arm_causes
from tests.gap.small_logs import data_of, hidden, panda, sliding

SMALL = ("torque_scale", "torque_offset", "external_spring", "coulomb_friction")


def library_of(log, *names: str) -> RegressorLibrary:
    return RegressorLibrary(data_of(panda(), log), [c for c in CAUSES if c.name in names])


@pytest.fixture(scope="module")
def heavy():
    """Link 4 half a kilogram heavier, its centre 2 cm off; 0.4 N·m of friction in joint 6."""
    sixth = np.eye(7)[5]
    true = with_link(panda(), 4, np.array([0.5, 0.06, 0.0, 0.02]))
    return hidden(panda(), lambda q, dq, ddq: 0.4 * sliding(q) * sixth, true=true)


def test_a_link_takes_the_place_of_the_crowd_that_stood_for_it(heavy) -> None:
    crowd = Chooser(library_of(heavy, *SMALL)).choose()
    library = library_of(heavy, *SMALL, "link_parameters")
    friction = Candidate("coulomb_friction", 5, ())
    assert len(crowd) > 3
    assert friction in crowd
    left = prefer_arm_causes(library, crowd)
    assert [(t.cause, t.joint + 1) for t in left if t.cause == "link_parameters"] == [
        ("link_parameters", 4)
    ]
    assert friction in left
    assert len(left) < len(crowd)
    assert description_length(library, left) < description_length(library, crowd)


def test_a_parameter_costs_what_it_does_not_bring(heavy) -> None:
    library = library_of(heavy, *SMALL, "link_parameters")
    link = next(t for t in library.candidates if (t.cause, t.joint) == ("link_parameters", 3))
    friction = Candidate("coulomb_friction", 5, ())
    none, both = description_length(library, []), description_length(library, [link, friction])
    assert both < description_length(library, [link]) < none
    idle = Candidate("torque_offset", 0, ())
    assert description_length(library, [link, friction, idle]) > both
    # nothing is put in place of a model that is right
    assert prefer_arm_causes(library, [link, friction]) == [link, friction]


@pytest.mark.parametrize(("offset", "little"), [(0.06, True), (0.12, False)])
def test_what_helps_little_is_listed_apart(offset, little) -> None:
    """Beside a newton metre of friction, an offset below the noise is no reason to mend a robot."""
    fifth = np.eye(7)[4]
    log = hidden(panda(), lambda q, dq, ddq: sliding(q) + offset * fifth, noise=0.2)
    found = diagnose_logs([log], "panda", causes=[c for c in CAUSES if c.name in SMALL])
    assert [c.name for c in found.causes] == ["coulomb_friction"] + ["torque_offset"] * (not little)
    assert [c.name for c in found.minor] == ["torque_offset"] * little
    listed = found.to_json()["minor"]
    assert [(x["name"], x["joints"]) for x in listed] == [("torque_offset", [5])] * little
    assert len(found.terms) == 8
