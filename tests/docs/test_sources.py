"""Every citation lands: sections of docs/sources.md, and modules that TOMLs name."""

import re
from importlib.util import find_spec
from pathlib import Path

from tests.command_line import ROOT

PAGE = (ROOT / "docs" / "sources.md").read_text("utf-8")
SECTIONS = set(re.findall(r"^##+ (\d(?:\.\d)?)\.? ", PAGE, re.MULTILINE))
CITED = re.compile(r"sources\.md ((?:\d(?:\.\d)?(?:, | and )?)+)")
PLACES = ("stiction_envs", "tuning", "benchmarks", "tests")


def files(*kinds: str) -> list[Path]:
    found = [p for place in PLACES for p in (ROOT / place).rglob("*") if p.suffix in kinds]
    return [p for p in found if p != Path(__file__)]


def sections(text: str) -> list[str]:
    """Return the numbers that follow ``sources.md``, line ends in comments left out."""
    flat = re.sub(r"\s*\n[ #]*", " ", text)
    return [n for group in CITED.findall(flat) for n in re.findall(r"\d(?:\.\d)?", group)]


def test_every_cited_section_is_there():
    cited = {n: p for p in files(".py", ".toml", ".xml", ".j2") for n in sections(p.read_text())}
    assert len(cited) > 20
    assert {n: str(p) for n, p in cited.items() if n not in SECTIONS} == {}


def test_no_citation_lacks_its_section():
    """`sources.md` is never cited as a whole."""
    loose = [
        str(p)
        for p in files(".py", ".toml", ".xml", ".j2")
        if re.search(r"sources\.md(?! \d)", re.sub(r"\s*\n[ #]*", " ", p.read_text()))
    ]
    assert loose == []


def test_modules_that_a_toml_names_exist():
    for path in files(".toml"):
        names = re.findall(r"\b(?:stiction_envs|benchmarks)(?:\.[a-z_]\w*)+", path.read_text())
        assert [n for n in names if find_spec(n) is None] == [], path
