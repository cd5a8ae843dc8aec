"""What is usable in a recording, what is wrong, what was assumed: python -m experiments.validate_recording FOLDER."""

from iwalker_jax.commands.launch import validate_recording

if __name__ == "__main__":
    validate_recording()
