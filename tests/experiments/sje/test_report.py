"""A Single Joint Experiment's report, of made torques."""

from types import SimpleNamespace

import pytest

from stiction_envs.experiments.sje.protocol import load_protocol
from stiction_envs.experiments.sje.results import write_report
from stiction_envs.measured.tables import SJERow


def row(joint, tau, *, amplitude=0.0, reduction=0.0):
    return SJERow(
        robot="panda",
        joint=joint,
        load="load",
        direction="+",
        frequency_hz=15.0 if amplitude else 0.0,
        amplitude_nm=amplitude,
        tau_nm=tau,
        std_nm=0.01,
        iterations=4,
        reduction=reduction,
    )


@pytest.fixture
def report(tmp_path):
    def write(rows):
        protocol = load_protocol("panda")
        result = SimpleNamespace(
            **{"rows": rows, "robot": "panda", "protocol": protocol, "note": ""},
            **{"servo_stiffness": None, "describe_stuck": lambda: ""},
        )
        write_report(tmp_path, result, ["torques.png"])
        return (tmp_path / "report.md").read_text("utf-8"), (tmp_path / "report.html").read_text()

    return write


def test_the_verdict_is_first_and_counts_what_dither_makes_worse(report):
    rows = [
        *(row(1, 0.8), row(1, 0.6, amplitude=1.0, reduction=0.25)),
        *(row(7, 0.5), row(7, 0.55, amplitude=0.4, reduction=-0.1)),
    ]
    text, page = report(rows)
    verdict = text.splitlines()[2]
    assert "falls by 8 % on average** over 2 configurations" in verdict
    assert "most on joint 1 (25 %), least on joint 7 (−10 %). It rises on joint 7." in verdict
    assert "| 7 | load pose | + | 15 Hz, 0.4 N·m | +0.5500 | 0.0100 | +10.0 % |" in text
    assert page.index("falls by 8 %") < page.index("<img ") < page.index("<table")
    assert 'src="data:image/png;base64,' in page
    assert "http" not in page
