"""A trained policy without the training stack: functions exported by name, and a loader that needs JAX alone."""

from typing import TYPE_CHECKING

from iwalker_jax.lazy_names import lazy_names

if TYPE_CHECKING:
    from iwalker_jax.deployment.exported_functions import ExportedFunction, exported_functions
    from iwalker_jax.deployment.loader import Artifact, ArtifactError, load, read_manifest, use_settings
    from iwalker_jax.deployment.writer import write_policy

__all__ = [
    "Artifact",
    "ArtifactError",
    "ExportedFunction",
    "exported_functions",
    "load",
    "read_manifest",
    "use_settings",
    "write_policy",
]

_HOMES = {
    "loader": "Artifact ArtifactError load read_manifest use_settings",
    "exported_functions": "ExportedFunction exported_functions",
    "writer": "write_policy",
}

__getattr__, __dir__ = lazy_names(__name__, _HOMES)
