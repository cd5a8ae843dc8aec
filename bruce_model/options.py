"""What the MJCF generator can be asked for: contact and solver settings, time step, floor and extra scenery."""

from dataclasses import dataclass, fields
from math import isfinite
from typing import Any
from xml.etree import ElementTree

from iwalker_jax.constants import TIME_STEP
from iwalker_jax.errors import InputError


def _require(record: Any, name: str, low: float, high: float) -> None:
    """Raise InputError unless the field is a finite number in [low, high], whole if `low` is an int."""
    value = getattr(record, name)
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool) and isfinite(value)
    if not is_number or not low <= value <= high or (isinstance(low, int) and value != int(value)):
        kind = "a whole number" if isinstance(low, int) else "a number"
        raise InputError(f"{type(record).__name__}.{name} is {value!r}; give {kind} from {low:g} to {high:g}.")


@dataclass(frozen=True)
class ContactParameters:
    """Contact between the feet and whatever they stand on, and the solver that enforces it.

    The foot spheres have priority over the ground, so their values hold on any ground.

    Attributes:
        friction: sliding friction coefficient.
        time_constant: of MuJoCo's contact spring (solref) [s].
        damping_ratio: of MuJoCo's contact spring (solref).
        impratio: ratio of frictional to normal constraint impedance; large values suppress slip.
        iterations: Newton iterations; below 6 the solver does not converge at low friction with impratio 10.
        line_search_iterations: per Newton iteration.
    """

    friction: float = 0.8
    time_constant: float = 0.01
    damping_ratio: float = 1.0
    impratio: float = 10.0
    iterations: int = 10
    line_search_iterations: int = 8

    def __post_init__(self) -> None:
        _require(self, "friction", 0.0, 10.0)
        _require(self, "time_constant", 1e-4, 1.0)
        _require(self, "damping_ratio", 1e-2, 10.0)
        _require(self, "impratio", 1e-2, 1e4)
        _require(self, "iterations", 1, 1000)
        _require(self, "line_search_iterations", 1, 1000)


@dataclass(frozen=True)
class MjcfOptions:
    """Options of the generator.

    Attributes:
        floor: whether the world has a flat checker floor at z = 0.
        timestep: of the simulation [s].
        contact: contact and solver settings.
        worldbody_xml: elements to append to <worldbody>, without joints; contact geoms in it collide with the feet
            if their conaffinity is 1.
        asset_xml: elements to append to <asset>, for what `worldbody_xml` refers to.
    """

    floor: bool = True
    timestep: float = TIME_STEP
    contact: ContactParameters = ContactParameters()
    worldbody_xml: str = ""
    asset_xml: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.floor, bool):
            raise InputError(f"MjcfOptions.floor is {self.floor!r}; give True or False.")
        if not isinstance(self.contact, ContactParameters):
            raise InputError(f"MjcfOptions.contact is {self.contact!r}; give a ContactParameters.")
        _require(self, "timestep", 1e-5, 0.02)
        if any(element.tag in ("joint", "freejoint") for element in self.worldbody_elements(recursive=True)):
            raise InputError("worldbody_xml has a joint, but the state holds the robot alone; give fixed bodies only.")
        xml_elements("asset_xml", self.asset_xml)

    def worldbody_elements(self, recursive: bool = False) -> list[ElementTree.Element]:
        """The parsed elements of `worldbody_xml`, at the top or at every level."""
        top = xml_elements("worldbody_xml", self.worldbody_xml)
        return [inner for element in top for inner in element.iter()] if recursive else top


def checked_options(options: dict[str, Any]) -> MjcfOptions:
    """Options from keyword arguments.

    Raises:
        InputError: an unknown name or a bad value.
    """
    known = [field.name for field in fields(MjcfOptions)]
    for name in options:
        if name not in known:
            raise InputError(f"The robot model has no option {name!r}; choose from {', '.join(known)}.")
    return MjcfOptions(**options)


def xml_elements(name: str, text: str) -> list[ElementTree.Element]:
    """Top elements of an XML fragment.

    Raises:
        InputError: the fragment is not well formed.
    """
    if not isinstance(text, str):
        raise InputError(f"{name} is a {type(text).__name__}; give a string of XML elements.")
    try:
        return list(ElementTree.fromstring(f"<fragment>{text}</fragment>"))
    except ElementTree.ParseError as error:
        raise InputError(f"{name} is not well-formed XML ({error}); give complete elements.") from error
