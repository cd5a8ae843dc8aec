"""The generator: an up-to-date file, options that do what they say, and one sentence for bad input."""

import subprocess
import sys
from xml.etree import ElementTree

import numpy as np
import pytest

from bruce_model import BRUCE_XML, ContactParameters, load_mujoco, mjcf_text
from bruce_model.generate import main
from iwalker_jax.errors import InputError

OBSTACLE = '<geom name="crate" type="box" size="0.1 0.1 0.1" pos="1 0 0.1" contype="0" conaffinity="1"/>'


def test_bruce_xml_is_up_to_date(monkeypatch, tmp_path, capsys):
    assert main(["--check"]) == 0
    assert BRUCE_XML.read_text(encoding="utf-8") == mjcf_text()
    monkeypatch.setattr("bruce_model.generate.BRUCE_XML", tmp_path / "bruce.xml")
    assert main(["--check"]) == 1
    assert "not up to date" in capsys.readouterr().err
    assert main([]) == 0
    assert main(["--check"]) == 0


def test_import_is_cheap():
    code = "import bruce_model, sys; print(sorted({'jax', 'mujoco', 'trimesh'} & set(sys.modules)))"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


def test_options_reach_the_model():
    contact = ContactParameters(friction=0.4, time_constant=0.02, impratio=3.0, iterations=6, line_search_iterations=5)
    model = load_mujoco(timestep=0.001, contact=contact, worldbody_xml=OBSTACLE)
    assert model.opt.timestep == 0.001
    assert (model.opt.impratio, model.opt.iterations, model.opt.ls_iterations) == (3.0, 6, 5)
    toe = model.geom("toe_r")
    assert toe.friction[0] == 0.4
    np.testing.assert_array_equal(toe.solref, [0.02, 1.0])
    assert toe.priority[0] > model.geom("crate").priority[0]
    assert model.geom("floor").type[0] == 0


def test_without_floor_the_world_holds_what_is_given():
    model = load_mujoco(floor=False, worldbody_xml=OBSTACLE)
    names = [model.geom(g).name for g in range(model.ngeom) if model.geom_bodyid[g] == 0]
    assert names == ["crate"]
    assert model.nq == 23


def test_extra_assets_are_found():
    asset = '<material name="brick" rgba="0.6 0.3 0.2 1"/>'
    model = load_mujoco(asset_xml=asset, worldbody_xml=OBSTACLE.replace("<geom", '<geom material="brick"'))
    assert model.material(model.geom("crate").matid[0]).name == "brick"


def test_text_is_deterministic_xml():
    assert mjcf_text() == mjcf_text()
    assert ElementTree.fromstring(mjcf_text()).get("model") == "bruce"


@pytest.mark.parametrize(
    "options",
    [
        {"flor": True},
        {"floor": "no"},
        {"timestep": 0.0},
        {"timestep": float("nan")},
        {"timestep": "fast"},
        {"contact": {"friction": 1.0}},
        {"worldbody_xml": "<geom"},
        {"worldbody_xml": None},
        {"worldbody_xml": "<body><freejoint/><geom size='1'/></body>"},
        {"worldbody_xml": "<geom type='box'/>"},
        {"worldbody_xml": "<geom size='1' material='unknown'/>"},
        {"asset_xml": "</asset>"},
    ],
)
def test_bad_options_give_one_sentence(options):
    with pytest.raises(InputError) as caught:
        load_mujoco(**options)
    message = str(caught.value)
    assert message.endswith(".")
    assert "\n" not in message


@pytest.mark.parametrize(
    "values", [{"friction": -0.1}, {"iterations": 0}, {"iterations": 2.5}, {"impratio": float("inf")}]
)
def test_bad_contact_values_are_refused(values):
    with pytest.raises(InputError, match="ContactParameters"):
        ContactParameters(**values)


def test_unknown_command_argument_is_refused(capsys):
    with pytest.raises(SystemExit):
        main(["--flor"])
    assert "--flor" in capsys.readouterr().err
