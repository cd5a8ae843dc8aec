"""The contact solver against Clarabel on random problems with a robot's pattern, and its batch behaviour."""

import clarabel
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import sparse

from iwalker_jax.robot.contact.solver import ContactProblem, ContactSettings, limit_forces, row_forces, solve_contact
from iwalker_jax.robot.limbs import Limbs
from tests.gradients import assert_gradients_agree

LIMBS = Limbs(starts=(6, 10, 12), sizes=(4, 2, 5), contacts=(2, 0, 2))
SIZE, ROWS = 17, 12

solve = jax.jit(lambda problem, start: solve_contact(LIMBS, ContactSettings(), problem, start))


def random_problem(rng: np.random.Generator) -> ContactProblem:
    """A badly scaled problem: mass ratios of 1e4, stiff rows, a third of the limits met."""
    limb_of = np.repeat([0, 1, 2], LIMBS.sizes)
    root = rng.normal(size=(SIZE, SIZE))
    chains = np.ones((SIZE, SIZE))
    chains[6:, 6:] = limb_of[:, None] == limb_of[None]
    scale = 10 ** rng.uniform(-1, 1, SIZE)
    mass = scale[:, None] * (root @ root.T * chains * 0.02 + np.diag(rng.uniform(1, 2, SIZE))) * scale
    rows = rng.normal(size=(ROWS, SIZE))
    for k, limb in enumerate(LIMBS.contacts):
        rows[4 * k : 4 * k + 4, 6:] *= limb_of == limb
    joints = SIZE - 6
    problem = (
        mass,
        rng.normal(size=SIZE) * 10,
        rng.choice([-1.0, 1.0], joints),
        10 ** rng.uniform(0, 3, joints) * (rng.uniform(size=joints) < 0.3),
        rng.normal(size=joints) * 10,
        rows,
        10 ** rng.uniform(0, 4, ROWS) * (rng.uniform(size=ROWS) < 0.8),
        rng.normal(size=ROWS) * 10,
    )
    return ContactProblem(*map(jnp.asarray, problem))


def clarabel_solution(problem: ContactProblem) -> np.ndarray:
    """The same minimum as a quadratic program with a slack for each row that counts."""
    p = ContactProblem(*map(np.asarray, problem))
    joints = SIZE - 6
    rows = np.concatenate([p.rows, np.hstack([np.zeros((joints, 6)), np.diag(p.limit_signs)])])
    stiffness = np.concatenate([p.stiffness, p.limit_stiffness])
    wanted = np.concatenate([p.reference, p.limit_reference])
    counts = stiffness > 0
    rows, stiffness, wanted = rows[counts], stiffness[counts], wanted[counts]
    m = len(wanted)
    cost = sparse.block_diag([np.triu(p.mass), np.diag(stiffness)], format="csc")
    linear = np.concatenate([-p.force, np.zeros(m)])
    constraint = sparse.csc_matrix(-np.hstack([rows, np.eye(m)]))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-12
    solver = clarabel.DefaultSolver(cost, linear, constraint, -wanted, [clarabel.NonnegativeConeT(m)], settings)
    return np.asarray(solver.solve().x[:SIZE])


@pytest.fixture
def problems(x64):
    rng = np.random.default_rng(1)
    return [random_problem(rng) for _ in range(20)]


def test_solutions_are_clarabels(problems):
    for problem in problems:
        solution = solve(problem, jnp.zeros(SIZE))
        expected = clarabel_solution(problem)
        np.testing.assert_allclose(solution.acceleration, expected, atol=1e-5 * np.abs(expected).max())
        assert solution.residual < 1e-10
        assert solution.iterations < 20


def test_any_start_gives_the_same(problems):
    first = solve(problems[0], jnp.zeros(SIZE)).acceleration
    np.testing.assert_allclose(solve(problems[0], 1e3 * jnp.ones(SIZE)).acceleration, first, rtol=1e-8)
    np.testing.assert_allclose(solve(problems[0], jnp.full(SIZE, jnp.nan)).acceleration, first, rtol=1e-8)
    assert solve(problems[0], first).iterations == 1


def test_single_precision(problems):
    for problem in problems:
        exact = solve(problem, jnp.zeros(SIZE)).acceleration
        narrow = solve(jax.tree.map(lambda x: x.astype(jnp.float32), problem), jnp.zeros(SIZE, jnp.float32))
        np.testing.assert_allclose(narrow.acceleration, exact, atol=1e-3 * np.abs(exact).max())


def test_forces_are_one_sided_and_balance(problems):
    for problem in problems[:5]:
        solution = solve(problem, jnp.zeros(SIZE))
        assert jnp.all(row_forces(problem, solution.acceleration) >= 0)


def test_a_batch_equals_a_loop_and_nan_stays_alone(problems):
    batch = jax.tree.map(lambda *x: jnp.stack(x), *problems)
    alone = [solve(problem, jnp.zeros(SIZE)) for problem in problems]
    starts = jnp.zeros((len(problems), SIZE))
    together = jax.jit(jax.vmap(lambda p, s: solve_contact(LIMBS, ContactSettings(), p, s)))
    clean = together(batch, starts)
    np.testing.assert_allclose(clean.acceleration, jnp.stack([s.acceleration for s in alone]), rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(clean.iterations, jnp.stack([s.iterations for s in alone]))
    spoiled = together(batch._replace(force=batch.force.at[3].set(jnp.nan)), starts)
    assert jnp.all(jnp.isnan(spoiled.acceleration[3]))
    assert jnp.isnan(spoiled.residual[3])
    assert spoiled.iterations[3] == 0
    others = jnp.arange(len(problems)) != 3
    np.testing.assert_array_equal(spoiled.acceleration[others], clean.acceleration[others])
    np.testing.assert_array_equal(spoiled.iterations[others], clean.iterations[others])


def test_the_iteration_limit_shows_in_the_residual(problems):
    short = jax.jit(lambda p: solve_contact(LIMBS, ContactSettings(max_iterations=1), p, jnp.zeros(SIZE)))
    solutions = [short(problem) for problem in problems]
    assert all(s.iterations == 1 for s in solutions)
    assert any(s.residual > 1e-6 for s in solutions)


def test_gradients(problems):
    """With respect to every continuous input; of the mass its symmetric part within the pattern."""
    limited = [p for p in problems if jnp.any(limit_forces(p, solve(p, jnp.zeros(SIZE)).acceleration) != 0)]
    problem = limited[0]

    def acceleration(mass, force, scales, references, rows):
        changed = problem._replace(
            mass=problem.mass + (mass + mass.T) * pattern,
            force=force,
            rows=problem.rows * rows,
            stiffness=problem.stiffness * scales[:ROWS],
            limit_stiffness=problem.limit_stiffness * scales[ROWS:],
            reference=references[:ROWS],
            limit_reference=references[ROWS:],
        )
        return solve(changed, jnp.zeros(SIZE)).acceleration

    limb_of = np.repeat([0, 1, 2], LIMBS.sizes)
    pattern = np.ones((SIZE, SIZE))
    pattern[6:, 6:] = limb_of[:, None] == limb_of[None]
    assert_gradients_agree(
        jax.jit(acceleration),
        jnp.zeros((SIZE, SIZE)),
        problem.force,
        jnp.ones(ROWS + SIZE - 6),
        jnp.concatenate([problem.reference, problem.limit_reference]),
        jnp.ones_like(problem.rows),
    )
