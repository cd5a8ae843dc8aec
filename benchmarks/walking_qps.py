"""Log the whole-body QPs of pushed walks, tick by tick, for `benchmarks.qp --file`.

python -m benchmarks.walking_qps --out runs/walking_qps.npz
"""

from iwalker_jax.runtime.settings import configure_runtime

if __name__ == "__main__":
    configure_runtime()

import argparse
from pathlib import Path

import jax
import jax.numpy as jnp

from iwalker_jax.control import make_plan, velocity_footsteps
from iwalker_jax.optimization import QuadraticProgram
from iwalker_jax.walking import (
    Conditions,
    Disturbances,
    WalkState,
    default_walker,
    sample_conditions,
    sense_and_control,
    start_walk,
    walk_tick,
)

_ROBOTS = 16
_BEFORE, _LOGGED = 2000, 640  # ticks: the pushes fall into the logged part


def log_programs(seed: int) -> QuadraticProgram:
    """Programs of all robots, one after the other; half are pushed by 2 N s sagittally, half by 1 N s sideways."""
    walker, _ = default_walker("none")
    plan = make_plan(*velocity_footsteps(0.1, 0.0, 0.0, 40, 0.24, 0.1, 1), 1)
    halves = [
        sample_conditions(walker.robot, pushed, _ROBOTS // 2, seed)
        for pushed in (Disturbances(push_impulse=2.0, push_axis="x"), Disturbances(push_impulse=1.0, push_axis="y"))
    ]
    conditions = jax.tree.map(lambda *parts: jnp.concatenate(parts), *halves)

    def walk(conditions: Conditions) -> QuadraticProgram:
        def tick(state: WalkState, _: None) -> tuple[WalkState, QuadraticProgram]:
            output = sense_and_control(walker, conditions, plan, state.memory, state.physics.qpos, state.physics.qvel)[
                1
            ]
            return walk_tick(walker, conditions, plan, state)[0], output.info.program

        def unlogged(_: int, state: WalkState) -> WalkState:
            return walk_tick(walker, conditions, plan, state)[0]

        state = jax.lax.fori_loop(0, _BEFORE, unlogged, start_walk(walker, conditions))
        return jax.lax.scan(tick, state, None, length=_LOGGED)[1]

    logged = jax.jit(jax.vmap(walk))(conditions)
    return jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), logged)


def main() -> int:
    """Log and save."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/walking_qps.npz"), help="file to write")
    parser.add_argument("--seed", type=int, default=0, help="of the robots' conditions")
    arguments = parser.parse_args()
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    programs = log_programs(arguments.seed)
    programs.save(arguments.out)
    print(f"{programs.q.shape[0]} programs are in {arguments.out}; python -m benchmarks.qp --file {arguments.out}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
