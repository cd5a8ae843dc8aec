"""Write a policy for a robot that has JAX alone: python -m experiments.export --run runs/default."""

from iwalker_jax.commands.launch import export

if __name__ == "__main__":
    export()
