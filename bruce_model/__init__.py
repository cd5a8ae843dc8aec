"""BRUCE as data: a parameter table, an MJCF generator and the generated bruce.xml.

The table follows Westwood-Robotics/BRUCE_simulation_models (Apache-2.0), corrected; PROVENANCE.md has the details.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from bruce_model.crouch import crouch_base_height, crouch_joints, crouch_qpos
from bruce_model.options import ContactParameters, MjcfOptions, checked_options

if TYPE_CHECKING:
    import mujoco

__all__ = [
    "BRUCE_XML",
    "ContactParameters",
    "MjcfOptions",
    "crouch_base_height",
    "crouch_joints",
    "crouch_qpos",
    "load_mujoco",
    "mjcf_text",
]

BRUCE_XML = Path(__file__).with_name("bruce.xml")
"""The generated model with default options."""


def mjcf_text(**options: Any) -> str:
    """MJCF text of the robot; keyword arguments are the fields of `MjcfOptions`.

    Raises:
        InputError: an unknown option or a bad value.
    """
    from bruce_model.mjcf import text_of

    return text_of(checked_options(options))


def load_mujoco(**options: Any) -> "mujoco.MjModel":
    """The compiled robot; keyword arguments are the fields of `MjcfOptions`.

    Raises:
        InputError: an unknown option or a bad value, or extra XML that MuJoCo refuses.
    """
    import mujoco

    from iwalker_jax.errors import InputError

    text = mjcf_text(**options)
    try:
        return mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise InputError(f"MuJoCo refuses the extra XML ({reason}); correct worldbody_xml or asset_xml.") from error
