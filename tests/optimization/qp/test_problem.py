"""The program as an object: checks at the boundary, printing, saving."""

import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.optimization import load_program, quadratic_program

EYE = np.eye(2)


def test_save_and_load(tmp_path):
    problem = quadratic_program(EYE, np.ones(2), EYE, -np.ones(2), np.ones(2), [("reach", 1), ("speed", 1)])
    problem.save(tmp_path / "bad.npz")
    loaded = load_program(tmp_path / "bad.npz")
    assert loaded.blocks == problem.blocks
    for before, after in zip(problem.arrays(), loaded.arrays()):
        np.testing.assert_array_equal(before, after)
    assert "reach: 1 rows" in str(loaded) and "2 variables" in str(loaded)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"P": np.array([[1, 1], [0, 1.0]])}, "not symmetric"),
        ({"P": np.diag([1, -1.0])}, "eigenvalue"),
        ({"q": np.array([np.nan, 0])}, "q is nan"),
        ({"low": np.array([2.0, 0])}, "exceeds high"),
        ({"high": np.array([np.nan, 0])}, "row 0"),
        ({"C": np.ones((2, 3))}, "shapes"),
    ],
)
def test_bad_programs_are_refused(change, words, unchecked_types):
    arrays = {"P": EYE, "q": np.zeros(2), "C": EYE, "low": -np.ones(2), "high": np.ones(2)} | change
    with pytest.raises(InputError, match=words):
        quadratic_program(**arrays)


def test_constraints_may_be_missing():
    assert quadratic_program(EYE, np.zeros(2)).C.shape == (0, 2)
    one_sided = quadratic_program(EYE, np.zeros(2), EYE, high=np.ones(2))
    assert jnp.all(one_sided.low == -jnp.inf)


def test_a_file_that_is_no_program(tmp_path):
    (tmp_path / "text.npz").write_text("no program")
    for name in ("text.npz", "missing.npz"):
        with pytest.raises(InputError, match="quadratic program"):
            load_program(tmp_path / name)
