"""The notebook runs as it is, prints what is shown, and says where Colab gets the package from."""

import base64
import io
import json
import re
from pathlib import Path
from typing import Any
from urllib.parse import quote

import nbformat
import pytest
from nbclient import NotebookClient

from tests.command_line import ROOT

NOTEBOOK = ROOT / "docs" / "first_look.ipynb"
PICTURE_BYTES = 100_000
"""Most bytes of a picture in it."""


def printed(notebook: Any) -> list[str]:
    """Return what each cell prints; on a slow machine a kernel sends it in several pieces."""
    code = [c for c in notebook.cells if c.cell_type == "code"]
    return ["".join(o.text for o in c.outputs if o.output_type == "stream") for c in code]


def pictures(notebook: Any) -> list[bytes]:
    """Return what its cells draw."""
    outputs = [o for c in notebook.cells if c.cell_type == "code" for o in c.outputs]
    return [
        base64.b64decode(o.data["image/png"]) for o in outputs if "image/png" in o.get("data", {})
    ]


@pytest.mark.slow
def test_it_runs_and_prints_what_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    shown = nbformat.read(NOTEBOOK, as_version=4)
    ran = nbformat.read(NOTEBOOK, as_version=4)
    client = NotebookClient(ran, timeout=300, resources={"metadata": {"path": str(tmp_path)}})
    client.execute()
    assert printed(ran) == printed(shown)
    assert printed(ran)[0] == ""  # the package is here: nothing is installed
    assert len(pictures(ran)) == len(pictures(shown)) == 2
    assert (tmp_path / "why" / "report.html").is_file()


def test_it_is_valid_small_and_ends_where_its_words_say() -> None:
    shown = nbformat.read(NOTEBOOK, as_version=4)
    nbformat.validate(shown)
    assert all(len(x) < PICTURE_BYTES for x in pictures(shown))
    said = "".join(printed(shown))
    hidden = re.search(r"hidden: (.*)\n", said)
    assert hidden is not None
    # its words: "Both are named, and nothing else"
    truth = {tuple(x.split(" in joint ")) for x in hidden[1].split(", ")}
    named = set(re.findall(r"^ *[\d.]+ %  (\w+) +joints (\d+)", said, re.MULTILINE))
    assert named == truth


def _opened_from(path: str, monkeypatch: pytest.MonkeyPatch) -> str:
    """Return what the first cell would install where Colab says that this is the notebook."""
    source = nbformat.read(NOTEBOOK, as_version=4).cells[1].source
    known: dict[str, Any] = {}
    # without what IPython alone understands
    exec(source.partition("\nif importlib")[0], known)
    asked = []

    def urlopen(address: str) -> io.StringIO:
        asked.append(address)
        return io.StringIO(json.dumps([{"path": path}]))

    known["urlopen"] = urlopen
    monkeypatch.setenv("COLAB_JUPYTER_IP", "172.28.0.12")
    monkeypatch.setenv("KMP_TARGET_PORT", "9000")
    out = known["opened_from"]()
    assert asked == ["http://172.28.0.12:9000/api/sessions"]
    return str(out)


def test_colab_installs_from_where_it_opened_the_notebook(monkeypatch: pytest.MonkeyPatch) -> None:
    address = "https://git.example/somebody/stiction/blob/main/docs/first_look.ipynb"
    for path in (f"fileId={quote(address, safe='')}", f"fileId={quote(address)}", address):
        found = _opened_from(path, monkeypatch)
        assert found == "git+https://git.example/somebody/stiction@main"
    with pytest.raises(RuntimeError, match="write the repository's address into REPOSITORY"):
        _opened_from("fileId=1aB2c3", monkeypatch)
