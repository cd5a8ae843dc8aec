"""What the library says at its boundaries: one sentence that tells what is wrong and what to do."""


class InputError(ValueError):
    """Bad input (a file, shape, unit, name or value); the message says what is wrong and what to do."""


class MissingFileError(InputError):
    """A file that is not there, where its absence may be answered in another way than damage."""


class CheckpointError(RuntimeError):
    """A checkpoint that cannot be written or read; the message says what is safe and what to do."""
