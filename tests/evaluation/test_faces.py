"""The faces of evaluation's rooms: every name is there once, and none takes the place of a module."""

import pkgutil
from types import ModuleType

import pytest

from iwalker_jax import evaluation
from iwalker_jax.evaluation import episodes, frames, walks


@pytest.mark.parametrize("room", [evaluation, frames, walks, episodes])
def test_every_name_is_there_once_and_hides_no_module(room: ModuleType):
    assert len(set(room.__all__)) == len(room.__all__)
    assert all(hasattr(room, name) for name in room.__all__)
    modules = {module.name for module in pkgutil.iter_modules(room.__path__)}
    assert not modules & set(room.__all__)
