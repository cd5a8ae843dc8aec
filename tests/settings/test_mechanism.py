"""The search for idle settings finds an idle one, in traced and in plain outcomes, by hand-made classes."""

from dataclasses import dataclass

import jax.numpy as jnp
import pytest

from iwalker_jax.errors import InputError
from tests.settings.mechanism import Probe, idle_fields


@dataclass(frozen=True)
class Kitchen:
    """One setting of every kind, two of which do nothing."""

    heat: float = 2.0
    colour: float = 3.0
    pots: int = 2
    spoons: int = 4
    lid: bool = True
    dish: str = "soup"

    def __post_init__(self) -> None:
        if self.dish not in ("soup", "stew"):
            raise InputError(f"There is no {self.dish}.")


def cook(kitchen: Kitchen):
    wasted = jnp.sin(jnp.asarray(kitchen.colour)) * kitchen.spoons
    del wasted
    return jnp.full(kitchen.pots, 1.0) * kitchen.heat * (2.0 if kitchen.lid else 1.0)


@pytest.mark.parametrize("traced", [True, False])
def test_idle_settings_are_found(traced):
    probe = Probe(cook, Kitchen(), changes={"dish": "stew"}, traced=traced)
    assert sorted(idle_fields(probe)) == ["colour", "dish", "spoons"]


def test_what_is_refused_is_not_idle():
    probe = Probe(cook, Kitchen(), refused={"dish": ("cake", "no cake")})
    assert sorted(idle_fields(probe)) == ["colour", "spoons"]
    with pytest.raises(AssertionError, match="give another value"):
        idle_fields(Probe(cook, Kitchen()))
