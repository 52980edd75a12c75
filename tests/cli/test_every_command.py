"""Every command has a help text, a readable report, and whole files on a full disk."""

from contextlib import nullcontext
from pathlib import Path

import pytest

from benchmarks.thesis import command as thesis
from stiction_envs.cli.dispatch import all_commands
from stiction_envs.robots import load_arm
from tests.browser import WIDTHS, wrong
from tests.cli.short_commands import FRICTION
from tests.gap.small_logs import hidden, write_csv
from tests.reporting.full_disk import REASONS, FullDisk

SIMULATING = ("sje", "gte", "tune", "calibrate", "export", "excite", "view")
NAMES = [module.__name__.rpartition(".")[2] for module in all_commands()]


@pytest.mark.parametrize("name", ["", *NAMES])
def test_help(cli, work, name):
    ran = cli(*name.split(), "--help")
    assert (ran.code, ran.err) == (0, "")
    assert list(work.iterdir()) == []
    if not name:
        assert "0 done" in ran.out
        return
    assert f"example:\n  stiction {name} " in ran.out
    options = {"--json", "--seed"} | (set() if name == "view" else {"--out", "--force"})
    assert ("1 defects found" in ran.out) == (name == "check"), "its exit codes differ"
    if name in SIMULATING:
        options |= {"--payload", "--tilt"}
    assert {o for o in options if o not in ran.out} == set()


TUNE = "tune {two.xml} --iterations 1 --no-scatter --frequencies 15 --scales 1"
REPORTING = {
    "sje": "sje {two.xml} --iterations 1 --no-scatter",
    "diagnose": "diagnose {log.csv} --robot {two.xml}",
    "tune": TUNE,
    "reproduce": "reproduce --only 2.3",
}


@pytest.mark.slow
@pytest.mark.parametrize("name", REPORTING)
@pytest.mark.usefixtures("log")
def test_a_report_can_be_read_on_a_desk_and_on_a_phone(cli, work, chromium, name):
    words = REPORTING[name].split()
    assert cli(*words, "--out", "out", commands=[*all_commands(), thesis]).code == 0
    pages = list(work.rglob("*.html"))
    assert pages
    for page in pages:
        for width in WIDTHS:
            assert not wrong(chromium, page, width), (page.name, width)


def whole(folder: Path) -> dict[str, bytes]:
    """Return the files of a folder but those that hold times."""
    found = {p.relative_to(folder).as_posix(): p for p in folder.rglob("*") if p.is_file()}
    return {k: p.read_bytes() for k, p in found.items() if not k.endswith((".db", ".jsonl"))}


@pytest.mark.parametrize(
    ("line", "resumes", "disks"),
    [
        pytest.param("export {two.xml}", False, 4, id="export"),
        pytest.param(TUNE, True, 2, id="tune", marks=pytest.mark.slow),
    ],
)
def test_a_full_disk_is_one_line_and_the_same_command_again_ends_as_undisturbed(
    cli, work, two, monkeypatch, line, resumes, disks
):
    """Files written before are whole; no half-written file is left."""

    def run(name: str, disk: FullDisk | None, *more: str):
        (work / name).mkdir(exist_ok=True)
        monkeypatch.chdir(work / name)
        with disk or nullcontext():
            return cli(*line.split(), "--out", "out", "--threads", 1, *more)

    watched = FullDisk(work / "clean")
    assert run("clean", watched).code == 0
    clean = whole(work / "clean")
    assert watched.count >= disks
    for at in sorted({round(1 + k * (watched.count - 1) / (disks - 1)) for k in range(disks)}):
        name = f"full from file {at} of {watched.count} on"
        ran = run(name, FullDisk(work / name, at))
        assert ran.code == 1, name
        errors = [x for x in ran.lines if x.startswith("error: ")]
        assert ran.lines[-1:] == errors, (name, ran.lines)
        assert "Traceback" not in ran.err, name
        assert any(reason in errors[0].lower() for reason in REASONS), errors
        assert "out" in errors[0], errors
        left = whole(work / name)
        assert not [x for x in left if ".part" in x], name
        changed = {k for k, v in left.items() if clean.get(k) != v}
        assert changed <= {"out/provenance.json", "out/trials.csv"}, name
        more = [] if resumes or not left else ["--force"]
        again = run(name, None, *more)
        assert again.code == 0, (name, again.err)
        assert whole(work / name) == clean, name


STATED = """<mujoco><worldbody><body name="l1"><joint name="a" axis="0 1 0" frictionloss="1.3"
 armature="0.1"/>
<geom size="0.1" pos="0 0 0.1" mass="2"/></body></worldbody>
<actuator><position joint="a" kp="200"/></actuator></mujoco>"""


@pytest.mark.parametrize(
    "line",
    [
        "export {own.xml} --json",
        "export {own.xml} --friction {dry.toml}",
        "check {log.csv} --robot {own.xml}",
        "identify {log.csv} --robot {own.xml}",
        "diagnose {log.csv} --robot {own.xml} --torque nonsense",
        pytest.param("conformance {own.xml}", marks=pytest.mark.slow),
        pytest.param("sje {own.xml} --iterations 1 --no-scatter", marks=pytest.mark.slow),
    ],
)
def test_one_line_says_what_is_taken_from_the_robots_file(cli, inputs, line):
    (inputs / "own.xml").write_text(STATED, "utf-8")
    (inputs / "dry.toml").write_text(FRICTION, "utf-8")
    write_csv(inputs / "log.csv", hidden(load_arm(inputs / "own.xml")))
    said = [x for x in cli(*line.split()).err.splitlines() if x.startswith("note: ")]
    if "nonsense" in line:  # an error of the command line comes before
        assert said == []
        return
    rotor, friction = "rotor inertia 0.1 kg·m²", "dry friction 1.3 N·m"
    taken, left = [rotor, friction], ["position servos (kp 200)"]
    if line.startswith(("check", "identify")):  # friction is not needed, or fitted
        taken, left = [rotor], [friction, *left]
    elif "dry.toml" in line:
        taken, left = [], [rotor, friction, *left]
    words = f"taken from the file: {', '.join(taken)}; " * bool(taken)
    assert said == [f"note: own: {words}left out: {', '.join(left)}"]
