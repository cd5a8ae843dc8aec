"""What an installation holds: no folders of everybody's names, and commands that need none of the present folder."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from setuptools import find_packages

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
def test_a_benchmark_without_its_extra_says_which(name, monkeypatch):
    """Property: whatever of the extra a benchmark imports, it asks for first."""
    text = (ROOT / "benchmarks" / name).read_text(encoding="utf-8")
    extra = [spec.partition(">")[0] for spec in PROJECT["project"]["optional-dependencies"]["benchmarks"]]
    for package in extra:
        if f"\nimport {package}" in text or f"\nfrom {package}" in text:
            assert f'"{package}"' in text.split("require(")[1].split(")")[0]
