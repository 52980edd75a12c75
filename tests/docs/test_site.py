"""The site builds without a warning, asks nothing of a network, and has no link into nothing."""

import re
import subprocess
import sys
from html.parser import HTMLParser
from urllib.parse import unquote, urldefrag

import gymnasium
import pytest

import stiction_envs
from stiction_envs.cli.dispatch import all_commands
from stiction_envs.gap.causes import registered
from tests.browser import WIDTHS, wrong
from tests.command_line import ROOT

pytest.importorskip("sphinx")
DOCS = ROOT / "docs"
FETCHED = {"script": "src", "img": "src", "iframe": "src", "source": "src", "link": "href"}
"""What a browser fetches by itself when it shows a page."""
ABSOLUTE = re.compile(r"([a-z]+:)?//")


class Page(HTMLParser):
    """Links, places to link to, and what is fetched, of one page."""

    def __init__(self, path):
        super().__init__()
        self.links, self.ids, self.fetched, self.tags = [], {""}, [], set()
        self.text = ""
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.tags.add(tag)
        self.ids |= {given[k] for k in ("id", "name") if given.get(k)}
        if tag == "a" and given.get("href"):
            self.links.append(given["href"])
        if given.get(FETCHED.get(tag, "")):
            self.fetched.append(given[FETCHED[tag]])
        self.fetched += [x.split()[0] for x in (given.get("srcset") or "").split(",") if x.strip()]

    def handle_data(self, data):
        self.text += data


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", DOCS]
    done = subprocess.run([*command, folder], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def pages(site):
    return {path: Page(path) for path in site.rglob("*.html")}


@pytest.mark.slow
def test_nothing_is_fetched_from_a_network(site, pages):
    assert len(pages) > 30
    for path, page in pages.items():
        assert page.fetched
        for address in page.fetched:
            assert not ABSOLUTE.match(address), f"{path.name} fetches {address}"
            where = path.parent / unquote(re.split("[?#]", address)[0])
            assert where.exists(), f"{path.name} fetches {address}, which is not there"
    for path in site.rglob("*.css"):
        text = re.sub(r"/\*.*?\*/", "", path.read_text(encoding="utf-8"), flags=re.S)
        for address in re.findall(r"(?:url\(|@import)\s*[\"']?([^\"')\s]+)", text):
            assert not ABSOLUTE.match(address), f"{path.name} fetches {address}"


@pytest.mark.slow
def test_every_link_inside_the_site_lands(site, pages):
    count = 0
    for path, page in pages.items():
        for link in page.links:
            if ABSOLUTE.match(link) or link.startswith("mailto:"):
                continue
            address, place = urldefrag(link)
            target = (path.parent / unquote(address)).resolve() if address else path
            assert target.exists(), f"{path.name} links to {link}"
            if target.suffix == ".html":
                assert unquote(place) in pages[target].ids, f"{path.name} links to {link}"
            count += 1
    assert count > 1000


@pytest.mark.slow
def test_everything_has_a_page(site):
    assert stiction_envs.__version__
    ours = [n for n, s in gymnasium.registry.items() if "stiction_envs" in str(s.entry_point)]
    assert len(ours) >= 4
    for name in ours:
        assert (site / "generated" / "environments" / f"{name}.html").is_file()
    for module in all_commands():
        name = module.__name__.rpartition(".")[2]
        assert (site / "generated" / "commands" / f"{name}.html").is_file()
    causes = (site / "generated" / "causes.html").read_text(encoding="utf-8")
    for cause in registered():
        assert f">{cause.name}<" in causes
    library = Page(site / "facade.html")
    for name in set(stiction_envs.__all__) - {"__version__"}:
        assert any(x.startswith("stiction_envs.") and x.endswith(f".{name}") for x in library.ids)


@pytest.mark.slow
def test_an_option_is_written_as_it_is_typed(site):
    page = (site / "generated" / "commands" / "sje.html").read_text(encoding="utf-8")
    assert '<span class="pre">--out</span>' in page
    assert "joint,frequency_hz,amplitude_nm[,waveform,offset_nm]" in page


def test_the_gallery_shows_every_picture_of_the_ways_in():
    text = (DOCS / "gallery.md").read_text(encoding="utf-8")
    for picture in DOCS.glob("*.png"):
        assert f"{{figure}} {picture.name}\n" in text


def test_no_generated_page_is_in_the_repository():
    tracked = subprocess.run(
        ["git", "ls-files", "docs"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if tracked.returncode:
        pytest.skip("no repository")
    assert "docs/conf.py" in tracked.stdout
    assert not [
        x for x in tracked.stdout.split() if x.startswith(("docs/generated", "docs/_build"))
    ]


@pytest.mark.slow
@pytest.mark.parametrize("width", WIDTHS)
def test_every_page_can_be_read_on_a_desk_and_on_a_phone(site, pages, chromium, width):
    assert not {path.name: found for path in pages if (found := wrong(chromium, path, width))}
