"""Runs what `iwalker-export` wrote: `load("policy")["control"](inputs)`. Needs JAX alone, so this file may be copied.

`jax.export` reads artifacts with `flatbuffers`, which is all that JAX itself asks for beside NumPy. JAX is imported
when the first artifact is loaded, so that `use_settings` can come before.
"""

import hashlib
import json
import os
import sys
import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

FORMAT = 1
"""Of the manifest; another one is another layout."""

MANIFEST = "manifest.json"

_MOST_MANIFEST = 1 << 24  # [bytes]
_MOST_ARTIFACT = 1 << 32  # [bytes]

_AGAIN = "export the policy again with `iwalker-export`"


class ArtifactError(ValueError):
    """An exported policy that cannot be used; the message says what is wrong and what to do."""


def manifest_digest(manifest: Mapping[str, Any]) -> str:
    """SHA-256 of a manifest without its own checksum: 64 hexadecimal digits."""
    content = {name: value for name, value in manifest.items() if name != "sha256"}
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def read_manifest(folder: str | Path) -> dict[str, Any]:
    """The manifest of an exported policy.

    Raises:
        ArtifactError: if there is none, or it is damaged or of another version.
    """
    file = Path(folder) / MANIFEST
    content = _read(file, _MOST_MANIFEST)
    try:
        manifest = json.loads(content)
        wanted, functions = manifest["sha256"], manifest["functions"]
        known = manifest["format"] == FORMAT
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise ArtifactError(f"{file} is damaged ({type(error).__name__}); {_AGAIN}.") from error
    if not known:
        raise ArtifactError(
            f"{file} is of format {manifest['format']!r:.40}, and this loader reads {FORMAT}; {_AGAIN}."
        )
    if wanted != manifest_digest(manifest) or not isinstance(functions, dict):
        raise ArtifactError(f"{file} does not match its checksum: it is damaged or was altered; {_AGAIN}.")
    return manifest


def use_settings(folder: str | Path) -> bool:
    """Set the process's XLA flags that the policy was exported with; False if they are of another version of jaxlib.

    Without them the same numbers come out more slowly, and rounding may differ in the last bits. Variables that are
    set already stay.

    Raises:
        ArtifactError: as `read_manifest`, or if JAX was imported before.
    """
    manifest = read_manifest(folder)
    if "jax" in sys.modules:
        raise ArtifactError("use_settings() came after `import jax`; call it first so that its settings apply.")
    from importlib.metadata import version

    if version("jaxlib") != manifest["versions"]["jaxlib"]:
        return False
    for name, value in manifest["environment"].items():
        os.environ.setdefault(name, value)
    return True


class Artifact:
    """One exported function of named arrays.

    Attributes:
        name: of the function.
        inputs, outputs: by name, what each array is, as in the manifest.
        call: the compiled function of a dictionary of arrays, without any check.
    """

    def __init__(self, name: str, entry: Mapping[str, Any], content: bytes) -> None:
        """Read an artifact; it is compiled when it is first called."""
        import jax
        from jax import export

        self.name, self.inputs, self.outputs = name, entry["inputs"], entry["outputs"]
        try:
            exported = export.deserialize(bytearray(content))
        except ImportError as error:
            raise ArtifactError(
                "jax.export cannot read artifacts without flatbuffers; `pip install flatbuffers`."
            ) from error
        except Exception as error:  # flatbuffers, struct and JAX each have kinds of their own
            reason = f"{type(error).__name__}: {error}".splitlines()[0][:160]
            raise ArtifactError(f"The function {name!r} cannot be read by this JAX ({reason}); {_AGAIN}.") from error
        backend = {"gpu": "cuda"}.get(jax.default_backend(), jax.default_backend())
        if backend not in exported.platforms:
            raise ArtifactError(
                f"The function {name!r} is for {' and '.join(exported.platforms)}, and this JAX runs on {backend}; "
                "set JAX_PLATFORMS to one of them."
            )
        self._exported = exported
        self.call = jax.jit(exported.call)

    def __call__(self, arrays: Mapping[str, Any]) -> dict[str, Any]:
        """Outputs by name.

        Raises:
            ArtifactError: for names, shapes or types other than the manifest's.
        """
        return self.call(self.checked(arrays))

    def checked(self, arrays: Mapping[str, Any]) -> dict[str, Any]:
        """The inputs among some arrays, so that a memory may come with the rest of what was returned beside it.

        Raises:
            ArtifactError: for names, shapes or types other than the manifest's.
        """
        import numpy as np

        chosen: dict[str, Any] = {}
        batches: set[int] = set()
        for name, wanted in self.inputs.items():
            if name not in arrays:
                raise ArtifactError(f"{self.name} lacks its input {name!r}, {wanted['meaning']}; give it.")
            array = arrays[name] if hasattr(arrays[name], "dtype") else np.asarray(arrays[name], wanted["dtype"])
            shape = tuple(wanted["shape"])
            fits = len(array.shape) == len(shape) and all(
                isinstance(n, str) or n == m for n, m in zip(shape, array.shape, strict=True)
            )
            batches.update(m for n, m in zip(shape, array.shape) if isinstance(n, str))
            if not fits or len(batches) > 1 or str(array.dtype) != wanted["dtype"]:
                raise ArtifactError(
                    f"{self.name}: the input {name!r} is {array.dtype} of shape {tuple(array.shape)}; "
                    f"give {wanted['dtype']} of shape {shape}."
                )
            chosen[name] = array
        return chosen


def load(folder: str | Path, names: Iterable[str] | None = None) -> dict[str, Artifact]:
    """The functions of an exported policy, all of them or those of some names.

    Raises:
        ArtifactError: if one is missing, damaged, altered, or not for this JAX or its device.
    """
    manifest = read_manifest(folder)
    functions = manifest["functions"]
    chosen = list(functions) if names is None else list(names)
    for name in chosen:
        if name not in functions:
            raise ArtifactError(f"There is no function {name!r:.80} in {folder}; choose of {', '.join(functions)}.")
    contents = {name: _content(Path(folder), functions[name]) for name in chosen}
    _check_versions(folder, manifest)
    return {name: Artifact(name, functions[name], content) for name, content in contents.items()}


def _check_versions(folder: str | Path, manifest: Mapping[str, Any]) -> None:
    from importlib.metadata import version

    from jax import export

    convention = manifest["versions"]["calling_convention"]
    least = export.minimum_supported_calling_convention_version
    most = export.maximum_supported_calling_convention_version
    if not least <= convention <= most:
        raise ArtifactError(
            f"{folder} was exported for JAX {manifest['versions']['jax']} (calling convention {convention}), and this "
            f"JAX {version('jax')} runs {least} to {most}; {_AGAIN} from a JAX nearer to it."
        )
    if version("jaxlib") != manifest["versions"]["jaxlib"]:
        warnings.warn(
            f"{folder} was exported with jaxlib {manifest['versions']['jaxlib']}; this one is {version('jaxlib')}, so "
            "that results may differ in their last bits.",
            stacklevel=3,
        )


def _content(folder: Path, entry: Mapping[str, Any]) -> bytes:
    file = folder / str(entry["file"])
    content = _read(file, _MOST_ARTIFACT)
    if hashlib.sha256(content).hexdigest() != entry["sha256"]:
        raise ArtifactError(f"{file} does not match its checksum: it is damaged or was altered; {_AGAIN}.")
    return content


def _read(file: Path, most: int) -> bytes:
    """Content of a regular file."""
    try:
        if file.exists() and not file.is_file():
            raise ArtifactError(f"{file} is no regular file; give the folder that `iwalker-export` wrote.")
        with file.open("rb") as stream:
            content = stream.read(most + 1)
    except FileNotFoundError:
        raise ArtifactError(f"{file} is missing: give the folder that `iwalker-export` wrote, or {_AGAIN}.") from None
    except (OSError, ValueError) as error:
        raise ArtifactError(
            f"{file} cannot be read ({getattr(error, 'strerror', None) or error}); {_AGAIN}."
        ) from error
    if len(content) > most:
        raise ArtifactError(f"{file} is larger than {most / 1e6:g} MB; it is none of an exported policy.")
    return content
