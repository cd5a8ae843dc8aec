"""Do whole-body losses in training make better episodes? python -m experiments.whole_body_study [--tasks 20]."""

from iwalker_jax.commands.launch import whole_body_study

if __name__ == "__main__":
    whole_body_study()
