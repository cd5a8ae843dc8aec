"""The loader of exported policies: right outputs by NumPy, JAX alone, and a sentence for whatever is damaged."""

import hashlib
import json
import subprocess
import sys
import textwrap

import numpy as np
import pytest

from iwalker_jax.deployment import loader
from iwalker_jax.deployment.exported_functions import exported_functions
from iwalker_jax.deployment.fields import field_of
from iwalker_jax.deployment.loader import ArtifactError
from iwalker_jax.deployment.named_arrays import from_named, named_arrays
from tests.deployment.folders import small_navigator, write_formula

INPUTS = {
    "time": np.float32(0.3),
    "path": np.arange(24, dtype=np.float32).reshape(4, 3, 2),
    "touching": np.array([True, True]),
}


@pytest.fixture(scope="module")
def navigator():
    return small_navigator()


@pytest.fixture
def folder(tmp_path, navigator):
    write_formula(tmp_path, navigator)
    return tmp_path


@pytest.mark.parametrize("rows", [1, 4])
def test_a_function_gives_what_its_formula_says(folder, rows):
    """Oracle: the same formula in NumPy, for several sizes of the symbolic batch."""
    inputs = INPUTS | {"path": INPUTS["path"][:rows]}
    outputs = loader.load(folder)["formula"](inputs | {"unasked": np.zeros(3)})
    np.testing.assert_array_equal(outputs["goal"], np.float32(2) * inputs["time"] + inputs["path"][:, 0])
    assert bool(outputs["solved"])


def test_the_manifest_says_what_everything_is(folder, navigator):
    manifest = loader.read_manifest(folder)
    entry = manifest["functions"]["formula"]
    content = (folder / entry["file"]).read_bytes()
    assert entry["sha256"] == hashlib.sha256(content).hexdigest()
    assert entry["platforms"] == ["cpu", "cuda"] and entry["rate_hz"] == 500.0
    assert entry["inputs"]["path"]["shape"] == ["batch", 3, 2]
    assert entry["inputs"]["time"] | {"meaning": ""} == {
        "shape": [],
        "dtype": "float32",
        "unit": "s",
        "frame": "",
        "meaning": "",
    }
    assert manifest["robot"]["joints"] == list(navigator.walker.robot.joint_names)
    assert "device_count" not in manifest["environment"]["XLA_FLAGS"]


def test_every_array_of_a_robot_is_described(navigator):
    """Property: no function takes or keeps an array without a unit and a meaning."""
    exported = exported_functions(navigator)
    assert list(exported) == ["start_control", "control", "start_frame", "frame", "footsteps", "ipath", "istepper"]
    assert [exported[name].rate for name in ("control", "frame")] == pytest.approx([500, 500 / 33])
    for entry in exported.values():
        for name in entry.inputs:
            assert field_of(name).meaning and field_of(name).unit


def test_named_arrays_give_back_the_tree_they_were_made_of():
    tree = ({"b": 1, "a": (2, 3)}, 4)
    named = named_arrays(tree, "x")
    assert named == {"x.0.a.0": 2, "x.0.a.1": 3, "x.0.b": 1, "x.1": 4}
    assert from_named(tree, named, "x") == tree


def test_the_copied_loader_needs_jax_alone(folder, tmp_path):
    """In a process in which whatever the training needs is forbidden, beside the artifacts, outside the package."""
    script = """
        import sys

        class Forbid:
            def find_spec(self, name, path=None, target=None):
                if name.partition(".")[0] in ("iwalker_jax", "bruce_model", "flax", "orbax", "optax", "mujoco", "cv2"):
                    raise ImportError(name)

        sys.meta_path.insert(0, Forbid())
        import load_policy
        assert load_policy.use_settings(".") and "jax" not in sys.modules
        import numpy as np
        outputs = load_policy.load(".")["formula"](dict(np.load("inputs.npz")))
        np.savez("outputs.npz", **{name: np.asarray(array) for name, array in outputs.items()})
        """
    np.savez(folder / "inputs.npz", **INPUTS)
    command = [sys.executable, "-c", textwrap.dedent(script)]
    done = subprocess.run(command, cwd=folder, env={"PATH": ""}, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    with np.load(folder / "outputs.npz") as outputs:
        np.testing.assert_array_equal(outputs["goal"], np.float32(2) * INPUTS["time"] + INPUTS["path"][:, 0])


def altered(folder, change):
    """Change a manifest's content; its checksum stays."""
    file = folder / loader.MANIFEST
    manifest = json.loads(file.read_text())
    change(manifest)
    file.write_text(json.dumps(manifest))


def resigned(folder, change):
    """Change a manifest's content, and sign it again."""

    def both(manifest):
        change(manifest)
        manifest["sha256"] = loader.manifest_digest(manifest)

    altered(folder, both)


def flipped(folder):
    file = folder / "formula.jaxexport"
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)


def no_artifact(folder):
    """Another file in an artifact's place, and a manifest that says so."""
    (folder / "formula.jaxexport").write_bytes(b"no artifact")
    digest = hashlib.sha256(b"no artifact").hexdigest()
    resigned(folder, lambda manifest: manifest["functions"]["formula"].update(sha256=digest))


DAMAGES = {
    "no manifest": (lambda f: (f / loader.MANIFEST).unlink(), "missing"),
    "no artifact": (lambda f: (f / "formula.jaxexport").unlink(), "missing"),
    "half a manifest": (lambda f: (f / loader.MANIFEST).write_bytes(b'{"format": 1'), "is damaged"),
    "no JSON": (lambda f: (f / loader.MANIFEST).write_bytes(b"\xff\xfe"), "is damaged"),
    "a list": (lambda f: (f / loader.MANIFEST).write_bytes(b"[]"), "is damaged"),
    "an altered manifest": (lambda f: altered(f, lambda m: m.update(policy="x")), "checksum"),
    "another format": (lambda f: resigned(f, lambda m: m.update(format=7)), "format 7"),
    "an old JAX": (
        lambda f: resigned(f, lambda m: m["versions"].update(calling_convention=1)),
        "calling convention 1",
    ),
    "a flipped bit": (flipped, "checksum"),
    "no StableHLO": (no_artifact, "cannot be read by this JAX"),
    "a folder": (lambda f: ((f / "formula.jaxexport").unlink(), (f / "formula.jaxexport").mkdir()), "no regular file"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_damage_is_told_in_a_sentence(folder, damage):
    spoil, words = DAMAGES[damage]
    spoil(folder)
    with pytest.raises(ArtifactError, match=words) as raised:
        loader.load(folder)
    assert str(raised.value).count("\n") == 0 and str(raised.value).endswith(".")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"time": None}, "lacks its input 'time'"),
        ({"time": np.zeros(2, np.float32)}, "of shape"),
        ({"path": np.zeros((4, 3, 2))}, "float64"),
        ({"path": np.zeros((4, 3), np.float32)}, "of shape"),
        ({"touching": np.zeros(2, np.float32)}, "give bool"),
    ],
)
def test_other_inputs_are_refused_in_a_sentence(folder, change, words):
    inputs = {name: array for name, array in (INPUTS | change).items() if array is not None}
    with pytest.raises(ArtifactError, match=words):
        loader.load(folder)["formula"](inputs)


def test_an_unknown_function_and_a_late_setting_are_refused(folder):
    with pytest.raises(ArtifactError, match="choose of formula"):
        loader.load(folder, ["walk"])
    with pytest.raises(ArtifactError, match="after `import jax`"):
        loader.use_settings(folder)


def test_another_jaxlib_is_said_but_not_refused(folder):
    resigned(folder, lambda manifest: manifest["versions"].update(jaxlib="0.0.1"))
    with pytest.warns(UserWarning, match="last bits"):
        assert list(loader.load(folder)) == ["formula"]
