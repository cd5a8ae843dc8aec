"""Train iPath and iStepper end to end: python -m experiments.train [--preset NAME] [--data FOLDER]."""

from iwalker_jax.commands.launch import train

if __name__ == "__main__":
    train()
