"""What an installation holds: no folders of everybody's names, and commands that need none of the present folder.

Wheel and source distribution are built as pip builds them, and what is installed works outside the source tree.
"""

import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
import yaml
from setuptools import find_packages

import iwalker_jax

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
COMMANDS = sorted(file.stem for file in (ROOT / "experiments").glob("*.py") if file.stem != "__init__")


def test_the_wheel_has_no_top_level_names_but_its_own():
    include = PROJECT["tool"]["setuptools"]["packages"]["find"]["include"]
    packages = find_packages(str(ROOT), include=include)
    assert {name.split(".")[0] for name in packages} == {"iwalker_jax", "bruce_model"}
    assert "iwalker_jax.commands.shared" in packages


def test_every_command_is_installed_and_kept_in_the_checkout():
    scripts = PROJECT["project"]["scripts"]
    assert scripts == {f"iwalker-{name.replace('_', '-')}": f"iwalker_jax.commands.launch:{name}" for name in COMMANDS}


def test_an_installed_command_minds_no_folder_of_the_same_name(tmp_path):
    """The entry point as pip's script calls it, in a folder whose own `experiments` and `benchmarks` fail on import."""
    for name in ("experiments", "benchmarks", "problems"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise SystemExit('the wrong folder')")
    script = tmp_path / "bin" / "iwalker-validate-recording"
    script.parent.mkdir()
    script.write_text(
        f"import sys\nsys.path.append({str(ROOT)!r})\n"
        "from iwalker_jax.commands.launch import validate_recording\nsys.exit(validate_recording())\n"
    )
    done = subprocess.run(
        [sys.executable, str(script), "--help"], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert "max-problems" in done.stdout


@pytest.mark.parametrize(
    "name", sorted(file.relative_to(ROOT / "benchmarks").as_posix() for file in (ROOT / "benchmarks").rglob("*.py"))
)
def test_a_benchmark_without_its_judge_says_which(name):
    """Property: what a benchmark imports of the extra at once, it asks for first; peers are imported when called."""
    text = (ROOT / "benchmarks" / name).read_text(encoding="utf-8")
    extra = [spec.partition(">")[0] for spec in PROJECT["project"]["optional-dependencies"]["peers"]]
    for package in extra:
        if f"\nimport {package}" in text or f"\nfrom {package}" in text:
            assert f'"{package}"' in text.split("require(")[1].split(")")[0]


def built(kind: str, source: Path, out: Path) -> Path:
    """The wheel or sdist of a source tree, built by the project's backend, without the network."""
    out.mkdir(exist_ok=True)
    code = f"from setuptools import build_meta; print(build_meta.build_{kind}({str(out)!r}))"
    done = subprocess.run([sys.executable, "-c", code], cwd=source, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return out / done.stdout.splitlines()[-1]


@pytest.fixture(scope="module")
def distributions(tmp_path_factory) -> tuple[Path, Path]:
    """(sdist, wheel built of what is in the sdist), as pip does from an index."""
    pytest.importorskip("setuptools", minversion="77")
    folder = tmp_path_factory.mktemp("packages")
    for name in ("iwalker_jax", "bruce_model"):
        shutil.copytree(ROOT / name, folder / "source" / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder / "source")
    sdist = built("sdist", folder / "source", folder)
    with tarfile.open(sdist) as archive:
        archive.extractall(folder / "unpacked", filter="data")
    (unpacked,) = (folder / "unpacked").iterdir()
    return sdist, built("wheel", unpacked, folder)


def test_the_wheel_holds_every_module_and_data_file(distributions):
    """Oracle: the source tree."""
    with zipfile.ZipFile(distributions[1]) as wheel:
        names = {name for name in wheel.namelist() if ".dist-info/" not in name}
    modules = {
        str(file.relative_to(ROOT)) for name in ("iwalker_jax", "bruce_model") for file in (ROOT / name).rglob("*.py")
    }
    data = PROJECT["tool"]["setuptools"]["package-data"]
    assert names == modules | {f"{package}/{file}" for package, files in data.items() for file in files}
    assert "iwalker_jax/py.typed" in names


def test_the_installed_wheel_works_outside_the_source_tree(distributions, tmp_path):
    """The shipped planner and the robot are found, from no other place than the installation."""
    place = tmp_path / "installed"
    command = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-index", "--no-compile"]
    subprocess.run([*command, "--target", str(place), str(distributions[1])], check=True, timeout=120)
    code = (
        "import iwalker_jax as iw, bruce_model; from iwalker_jax.training import load_planner; "
        "load_planner(), bruce_model.load_mujoco(); print(iw.__file__, iw.__version__, bruce_model.__file__)"
    )
    environment = os.environ | {"PYTHONPATH": str(place), "JAX_PLATFORMS": "cpu"}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    file, version, other_file = done.stdout.split()
    assert (file, other_file) == tuple(str(place / name / "__init__.py") for name in ("iwalker_jax", "bruce_model"))
    assert version == PROJECT["project"]["version"]
    script = [str(place / "bin" / "iwalker-validate-recording"), "--help"]
    shown = subprocess.run(script, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120)
    assert shown.returncode == 0 and "max-problems" in shown.stdout, shown.stderr


def test_the_container_runs_the_two_commands_of_the_readme():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    wanted = [line.partition("#")[0].strip() for line in readme.split("```bash\n")[1].split("```")[0].splitlines()]
    docker = (ROOT / "Dockerfile").read_text(encoding="utf-8")
    installs = re.findall(r"^RUN (pip .+)$", docker, re.MULTILINE)
    starts = re.findall(r"^CMD (.+)$", docker, re.MULTILINE)
    assert [f"{install} && {start}" for install, start in zip(installs, starts, strict=True)] == wanted


def test_citation_and_package_say_the_same_version():
    """CITATION.cff is YAML with the keys that its format asks for."""
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= set(citation)
    assert citation["version"] == PROJECT["project"]["version"] == iwalker_jax.__version__
    assert citation["license"] == PROJECT["project"]["license"]
