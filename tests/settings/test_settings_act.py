"""Every field of every configuration class acts: changing it changes an outcome, or is refused with a sentence.

The classes are found by reflection: all dataclasses of the library whose fields all have defaults. A new one without a
probe fails here, and so does a new field that does nothing. An outcome is a program wherever one is big: whether its
results depend on a number can be read off it without running it.
"""

import dataclasses
import importlib
import inspect
import pkgutil

import pytest

import iwalker_jax
from tests.settings import on_policy_probes, robot_probes, training_probes
from tests.settings.mechanism import idle_in_all
from tests.settings.small_probes import PROBES as SMALL_PROBES

PROBES = {
    **{kind: (probe,) for kind, probe in SMALL_PROBES.items()},
    **robot_probes.PROBES,
    **training_probes.PROBES,
    **on_policy_probes.PROBES,
}

RESULTS = {"Study", "MeshSolids", "MjcfSolids"}
"""Dataclasses whose fields all have defaults but which hold results, not settings."""

ELSEWHERE = {
    "ContactSettings": "tests/robot/test_contact.py",
    "FilmSettings": "tests/evaluation/episodes/test_film.py",
    "ProcessGroup": "tests/runtime/test_processes.py",
    "RouteParameters": "tests/scenes/test_routes.py",
    "SimulationSettings": "tests/deployment/test_live.py",
    "ShortfallCharge": "tests/evaluation/frames/test_reference_plans.py",
    "Style": "tests/scenes/test_layout.py",
    "TaskSampling": "tests/tasks/test_generated.py",
    "VideoSettings": "tests/film/test_video.py",
    "WatchdogLimits": "tests/deployment/test_live.py",
}
"""Settings of physics, films, processes and scenes, of which no planner and no controller knows; and their tests."""


def configuration_classes() -> dict[str, type]:
    """All dataclasses of the library whose fields all have defaults, by name; options of commands, which
    `tests/experiments` gives one by one, are not among them."""
    found = {}
    for info in pkgutil.walk_packages(iwalker_jax.__path__, "iwalker_jax."):
        if info.name.startswith("iwalker_jax.commands"):
            continue
        module = importlib.import_module(info.name)
        for name, kind in inspect.getmembers(module, inspect.isclass):
            if dataclasses.is_dataclass(kind) and kind.__module__ == info.name:
                fields = dataclasses.fields(kind)
                if fields and not any(f.default is f.default_factory for f in fields):
                    found[name] = kind
    return found


def test_every_configuration_class_has_a_probe():
    missing = configuration_classes().keys() - {kind.__name__ for kind in PROBES} - RESULTS - ELSEWHERE.keys()
    assert not missing, f"give these a probe in tests/settings: {sorted(missing)}"


@pytest.fixture(scope="module", autouse=True)
def prepared():
    robot_probes.prepare()
    training_probes.prepare()
    on_policy_probes.prepare()


@pytest.mark.parametrize("kind", PROBES, ids=lambda kind: kind.__name__)
def test_every_field_acts(kind):
    assert idle_in_all(PROBES[kind]) == []
