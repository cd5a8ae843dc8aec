"""Train iPath with a memory on policy: python -m experiments.train_memory [--preset NAME]."""

from iwalker_jax.commands.launch import train_memory

if __name__ == "__main__":
    train_memory()
