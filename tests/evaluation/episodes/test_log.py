"""The log of episodes: read back as written, in full precision, after a crash too."""

import math

import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.episodes.log import EpisodeKey, append_episodes, load_episodes
from iwalker_jax.evaluation.episodes.metrics import EpisodeMetrics
from iwalker_jax.navigation.record import Outcome

KEY = EpisodeKey("pretrained", "noisy", "estimated", 0, 10, "default", "office", 3)
FIGURES = EpisodeMetrics(Outcome.FELL, 1 / 3, 2.0, 3.0, 0.0, 0.1, 0.5, 1.7, 0.8, 0.0, math.nan, 0.25)


def test_what_is_appended_is_read_back(tmp_path):
    file = tmp_path / "new" / "episodes.csv"
    assert load_episodes(file) == {}
    append_episodes(file, [(KEY, "office", FIGURES)])
    append_episodes(file, [(KEY._replace(number=4), "an office, with a comma", FIGURES._replace(shaking=0.1))])
    got = load_episodes(file)
    assert list(got) == [KEY, KEY._replace(number=4)]
    assert got[KEY]._replace(shaking=0) == FIGURES._replace(shaking=0) and math.isnan(got[KEY].shaking)
    assert got[KEY].outcome is Outcome.FELL


def test_a_line_cut_short_is_passed_over_and_written_again(tmp_path):
    file = tmp_path / "episodes.csv"
    append_episodes(file, [(KEY._replace(number=n), "office", FIGURES) for n in range(3)])
    file.write_bytes(file.read_bytes()[:-25])
    assert [key.number for key in load_episodes(file)] == [0, 1]
    append_episodes(file, [(KEY._replace(number=2), "office", FIGURES)])
    assert [key.number for key in load_episodes(file)] == [0, 1, 2]


def test_a_last_number_cut_short_is_not_taken_for_whole(tmp_path):
    """A line that lacks but its end could have lost the last digit of a number."""
    file = tmp_path / "episodes.csv"
    append_episodes(file, [(KEY._replace(number=n), "office", FIGURES) for n in range(2)])
    file.write_bytes(file.read_bytes()[:-1])
    assert [key.number for key in load_episodes(file)] == [0]
    append_episodes(file, [(KEY._replace(number=1), "office", FIGURES)])
    assert [metrics.detours for metrics in load_episodes(file).values()] == [0.25, 0.25]


def test_a_header_cut_short_is_written_again(tmp_path):
    file = tmp_path / "episodes.csv"
    file.write_text("planner,dep")
    assert load_episodes(file) == {}
    append_episodes(file, [(KEY, "office", FIGURES)])
    assert list(load_episodes(file)) == [KEY]


def test_another_programs_file_is_left_alone(tmp_path):
    (tmp_path / "episodes.csv").write_text("name,value\na,1\n")
    with pytest.raises(InputError, match="other columns"):
        load_episodes(tmp_path / "episodes.csv")


def test_a_file_that_cannot_be_written(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be written"):
        append_episodes(tmp_path / "file" / "episodes.csv", [])


def test_a_damaged_line_is_passed_over_and_the_others_are_kept(tmp_path):
    """Every single bit of the middle line: its episode counts as not run, or is as it was."""
    file = tmp_path / "episodes.csv"
    whole = FIGURES._replace(shaking=0.5)
    append_episodes(file, [(KEY._replace(number=n), "office", whole) for n in range(3)])
    content = file.read_bytes()
    first = content.index(b"\n", content.index(b"\n") + 1) + 1
    end = content.index(b"\n", first)
    for bit in range(8 * first, 8 * end):
        damaged = bytearray(content)
        damaged[bit // 8] ^= 1 << (bit % 8)
        file.write_bytes(bytes(damaged))
        found = load_episodes(file)
        assert set(found.values()) == {whole}
        assert {key.number for key in found} in ({0, 2}, {0, 1, 2})
