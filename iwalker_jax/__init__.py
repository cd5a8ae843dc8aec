"""iwalker-jax: a humanoid's sense-plan-act loop as one differentiable JAX program.

Importing this package is cheap and has no side effects; import the room you need, for example
``from iwalker_jax.optimization import solve_unicycle``.
"""

__version__ = "0.1.0"
