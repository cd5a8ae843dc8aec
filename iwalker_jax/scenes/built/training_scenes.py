"""Seeded generator of training scenes: fifteen families with unlimited layouts each."""

from iwalker_jax.errors import InputError
from iwalker_jax.scenes.built import passage_families as passages
from iwalker_jax.scenes.built import room_families as rooms
from iwalker_jax.scenes.built.free_space import Family, draw_connected
from iwalker_jax.scenes.built.layout import TRAINING_STYLE
from iwalker_jax.scenes.scene import Scene
from iwalker_jax.streams import family_stream

_GENERATORS: dict[str, Family] = {
    "corridor_doors": passages.corridor,
    "l_corridor": passages.l_corridor,
    "t_corridor": passages.t_corridor,
    "joined_rooms": passages.joined_rooms,
    "landing": passages.landing,
    "slalom": passages.slalom,
    "narrow_gap": passages.narrow_gap,
    "open_office": rooms.open_office,
    "meeting_room": rooms.meeting_room,
    "living_room": rooms.living_room,
    "kitchen": rooms.kitchen,
    "warehouse": rooms.warehouse,
    "factory_hall": rooms.factory_hall,
    "storage": rooms.storage,
    "lobby": rooms.lobby,
}

FAMILIES: tuple[str, ...] = tuple(_GENERATORS)
"""Names of the families of training scenes."""


def generate_scene(family: str, seed: int) -> Scene:
    """The training scene of a family and a seed; the same arguments give the same scene.

    Layouts whose free space is small or falls apart are drawn again (from a sub-seed, so the result stays a function
    of the seed).

    Args:
        family: one of `FAMILIES`.
        seed: a whole number from 0 to 2^32 - 1.

    Raises:
        InputError: for an unknown family or a seed out of its range.
    """
    if family not in _GENERATORS:
        raise InputError(f"Unknown scene family {family!r}; choose one of {', '.join(FAMILIES)}.")
    if seed < 0:
        raise InputError(f"A scene's seed must not be negative, got {seed}.")
    stream = family_stream(FAMILIES.index(family))
    return draw_connected(f"{family}-{seed}", family, _GENERATORS[family], TRAINING_STYLE, stream, seed)
