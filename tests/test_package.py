"""The wheel: metadata, data files, and an import that needs no extra."""

import ast
import itertools
import re
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import pytest

import stiction_envs
from tests.command_line import python

TOP = Path(__file__).parents[1]
PACKAGES = ("stiction_envs", "tuning")
PROJECT = tomllib.loads((TOP / "pyproject.toml").read_text("utf-8"))
ELSEWHERE = {"pinocchio": ["pin"], "warp": ["warp-lang"]}
"""Modules that lie where `importlib.metadata` does not look, or of extras that may be missing."""
NOT_OURS = re.compile(r"\.(?!ci$).+|__pycache__|venv|build|dist|runs|.+\.egg-info")
"""Names of directories that hold nothing a clone would have."""


def own_files(directory: Path) -> Iterator[Path]:
    """Every file under `directory` but what tools and runs left there."""
    for path in sorted(directory.iterdir()):
        if not path.is_dir():
            yield path
        elif not NOT_OURS.fullmatch(path.name):
            yield from own_files(path)


SOURCES = [p for name in PACKAGES for p in own_files(TOP / name) if p.suffix == ".py"]


def distribution(requirement: str) -> str:
    """The name in a requirement or a pin, as package indexes compare it."""
    return re.match(r"[\w.-]+", requirement)[0].lower().replace("_", "-")


def shown(path: Path) -> str:
    return str(path.relative_to(TOP))


def test_import_and_make_need_no_extra():
    code = """
import sys

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {"torch", "stable_baselines3", "pyarrow"}:
            raise ImportError(f"{name} was asked for")

sys.meta_path.insert(0, Blocker())
import gymnasium, stiction_envs, tuning
gymnasium.make("stiction_envs:PandaSJE-v0")
"""
    done = python(code)
    assert done.returncode == 0, done.stderr


def test_the_facade_hands_on_functions_whatever_was_imported_before():
    """`tuning.search` is a package: once it is imported, that name is no function."""
    points = PROJECT["project"]["entry-points"]["stiction_envs.api"]
    code = f"""
import tuning.protocol.tune, tuning.search.search
from importlib.metadata import EntryPoint
for name, value in {points}.items():
    found = EntryPoint(name, value, "stiction_envs.api").load()
    assert callable(found), found
"""
    done = python(code)
    assert done.returncode == 0, done.stderr


def test_one_version():
    assert PROJECT["project"]["dynamic"] == ["version"]
    versions = re.findall(r"^## \[(.+?)\]", (TOP / "CHANGELOG.md").read_text("utf-8"), re.M)
    assert versions[0] == stiction_envs.__version__
    cited = re.search(r"^version: (.+)$", (TOP / "CITATION.cff").read_text("utf-8"), re.M)
    assert cited[1] == stiction_envs.__version__


@pytest.mark.slow
def test_the_wheel_is_small_and_holds_the_packages_alone(tmp_path):
    made = [sys.executable, "-m", "build", "--no-isolation", "--wheel", "--outdir", str(tmp_path)]
    subprocess.run([*made, str(TOP)], check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    assert wheel.stat().st_size < 1.5e6
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert names == {shown(path) for name in PACKAGES for path in own_files(TOP / name)}


def test_every_requirement_is_pinned():
    pins = (TOP / "constraints.txt").read_text("utf-8").splitlines()
    pins = [line for line in pins if not line.startswith("#")]
    assert [line for line in pins if not re.fullmatch(r"[\w.-]+==[\w.]+( ; .+)?", line)] == []
    project = PROJECT["project"]
    wanted = itertools.chain(project["dependencies"], *project["optional-dependencies"].values())
    names = {distribution(line) for line in wanted} - {project["name"]}
    assert names - {distribution(p) for p in pins} == set()


def imports(path: Path) -> Iterator[tuple[str, bool]]:
    """Yield every top-level module a file imports, and whether importing the file does."""
    tree = ast.parse(path.read_text("utf-8"))
    late = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.If | ast.Try)
        for inner in ast.walk(node)
    }
    for node in ast.walk(tree):
        names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
        names += [str(node.module)] if isinstance(node, ast.ImportFrom) else []
        yield from ((name.partition(".")[0], id(node) not in late) for name in names)


def test_every_import_is_declared():
    """An import at module level is a dependency; an import in a function may be an extra."""
    project, owner = PROJECT["project"], {**metadata.packages_distributions(), **ELSEWHERE}
    always = {distribution(x) for x in project["dependencies"]}
    extras = {
        distribution(x)
        for k, v in project["optional-dependencies"].items()
        if k != "dev"
        for x in v
    }
    used: dict[str, set[bool]] = {}
    for path in SOURCES:
        for module, at_once in imports(path):
            if module not in sys.stdlib_module_names and module not in PACKAGES:
                names = {distribution(x) for x in owner.get(module, [module])}
                (name,) = names & (always | extras) or names
                used.setdefault(name, set()).add(at_once)
    assert set(used) - always - extras == set()
    assert {name for name, when in used.items() if True in when} - always == set()
    assert always - set(used) == set()


@pytest.mark.parametrize(
    ("code", "says"),
    [
        (
            "from stiction_envs.measured.logs.reader import read_logs; read_logs(['a.parquet'], 7)",
            "a.parquet: reading .parquet needs pyarrow: pip install 'stiction-envs[parquet]'",
        ),
        (
            "import stiction_envs.envs.sb3",
            "stiction_envs.envs.sb3 needs stable-baselines3: pip install 'stiction-envs[rl]'",
        ),
        (
            "import tuning.policies.train",
            "stiction train needs stable-baselines3: pip install 'stiction-envs[rl]'",
        ),
    ],
)
def test_a_missing_extra_is_one_clear_line(code, says, tmp_path):
    (tmp_path / "a.parquet").write_bytes(b"PAR1")
    block = "import sys; sys.modules.update(pyarrow=None, stable_baselines3=None)"
    done = python(f"{block}; {code}", cwd=tmp_path)
    assert done.stderr.splitlines()[-1] == f"stiction_envs.errors.StictionError: {says}"


def test_no_package_host_is_written_down():
    """The machine sets the package host (pip's configuration), not the repository."""
    host = re.compile(
        rb"pypi\.org|pythonhosted\.org|download\.pytorch\.org|anaconda\.(?:org|com)"
        rb"|index-ur[l]|find-link[s]|trusted-hos[t]"
    )
    assert [shown(p) for p in own_files(TOP) if host.search(p.read_bytes())] == []


# ---- what a first contact loads: loading is most of its time -------------------------------------

HEAVY = ("mujoco", "numba", "scipy", "pinocchio", "matplotlib", "optuna", "PIL", "torch")


def loaded(code: str) -> set[str]:
    """Return the modules that a fresh process has loaded after ``code``."""
    ran = python(f"{code}\nimport sys; print('modules:', *sys.modules)")
    assert ran.returncode == 0, ran.stderr
    return set(ran.stdout.rpartition("modules:")[2].split())


@pytest.mark.parametrize(
    "code",
    [
        "import stiction_envs",
        "from stiction_envs.cli import main; assert main(['--help']) == 0",
        "from stiction_envs.cli import main; assert main(['--version']) == 0",
    ],
    ids=["import", "help", "version"],
)
def test_the_package_and_its_help_load_nothing_heavy(code):
    assert loaded(code) & set(HEAVY) == set()


@pytest.mark.parametrize("name", ["PandaSJE-v0", "PandaGTE-v0"])
def test_an_environment_loads_only_what_it_needs(name):
    """SciPy's linear algebra comes with numba."""
    modules = loaded(f"import gymnasium; gymnasium.make('stiction_envs:{name}').reset(seed=0)")
    unwanted = {"scipy.signal", "scipy.stats", "scipy.spatial", "pinocchio", "matplotlib", "optuna"}
    assert modules & unwanted == set()
