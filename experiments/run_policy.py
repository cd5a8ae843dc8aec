"""Run an exported policy in real time: python -m experiments.run_policy runs/policy --simulate office."""

from iwalker_jax.commands.launch import run_policy

if __name__ == "__main__":
    run_policy()
