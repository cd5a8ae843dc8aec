"""The room's faces: every name that they promise is there, says what it is, and is the same in both."""

import inspect

import pytest

from iwalker_jax import optimization
from iwalker_jax.optimization import qp, steps, unicycle


@pytest.mark.parametrize("face", [optimization, qp, steps, unicycle])
def test_every_promised_name_is_there_and_documented(face):
    assert face.__all__ == sorted(face.__all__, key=lambda name: (name.islower(), name))
    for name in face.__all__:
        value = getattr(face, name)
        if inspect.isclass(value) or inspect.isfunction(value):
            assert value.__doc__, f"{face.__name__}.{name} has no docstring"


@pytest.mark.parametrize("face", [qp, steps, unicycle])
def test_the_house_face_shows_the_rooms_own(face):
    for name in set(face.__all__) & set(optimization.__all__):
        assert getattr(optimization, name) is getattr(face, name)
