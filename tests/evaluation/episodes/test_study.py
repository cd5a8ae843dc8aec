"""Studies with a program that only pretends to walk: what is logged, gone on with, drawn and reported."""

import csv
import dataclasses
from html.parser import HTMLParser

import numpy as np
import pytest

from iwalker_jax.film.headless import configure_rendering

configure_rendering()

from iwalker_jax.errors import InputError  # noqa: E402
from iwalker_jax.evaluation.episodes.film import FilmSettings  # noqa: E402
from iwalker_jax.evaluation.episodes.metrics import episode_metrics, row_of  # noqa: E402
from iwalker_jax.evaluation.episodes.report import Report, write_report  # noqa: E402
from iwalker_jax.evaluation.episodes.schedule import StudySettings, conditions_seed, episode_batches, scheduled_episodes  # noqa: E402
from iwalker_jax.evaluation.episodes.study import run_episode_study  # noqa: E402
from iwalker_jax.evaluation.episodes.traces import has_traces, load_traces, save_traces, traces_file  # noqa: E402
from iwalker_jax.walking import Disturbances, default_walker, sample_conditions  # noqa: E402
from tests.evaluation.episode_records import StubProgram, make_record  # noqa: E402

SETTINGS = StudySettings(
    "pretrained", policies=("default", "classical"), episode_sets=("corridor", "test_office"), seeds=3, width=3
)
FILM = FilmSettings(height=120, pace=10, samples=0)


class Maker:
    """Makes stub programs and remembers what was asked of them."""

    def __init__(self) -> None:
        self.made, self.runs = [], []

    def __call__(self, policy, width, images):
        self.made.append((policy, width, images))
        return StubProgram(images, self.runs)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A study of 2 policies x 2 sets x 3 seeds in batches of three, with films where they can be drawn."""
    folder, maker, heard, said = tmp_path_factory.mktemp("study"), Maker(), [], []
    study = run_episode_study(SETTINGS, maker, folder, FILM, heard.append, said.append)
    return folder, maker, study, heard, said


def test_every_policy_runs_every_task_in_batches(finished):
    folder, maker, study, heard, _ = finished
    assert maker.made == [("default", 3, False), ("classical", 3, False), ("default", 1, True)]
    # Each batch has a seed of its own, the same one for every policy.
    corridor, office = (conditions_seed(0, name, 0) for name in SETTINGS.episode_sets)
    assert corridor != office
    assert maker.runs[:4] == [(3, corridor), (3, office)] * 2
    assert {key: len(episodes) for key, episodes in study.groups.items()} == {
        (policy, name): 3 for policy in SETTINGS.policies for name in SETTINGS.episode_sets
    }
    with (folder / "episodes.csv").open() as stream:
        lines = list(csv.DictReader(stream))
    assert len(lines) == 12
    assert [line["outcome"] for line in lines] == ["reached", "reached", "collided"] * 4
    assert lines[3]["episode_set"] == "test_office" and lines[3]["policy"] == "default" and lines[3]["number"] == "0"
    assert heard[0].done == 0 and heard[-1] == (12, 12, "classical", 0)
    assert sorted(progress.done for progress in heard) == [progress.done for progress in heard]
    assert study.groups["default", "test_office"][0].shortest == pytest.approx(float(lines[3]["shortest"]))


def test_tables_and_sheets_are_there(finished):
    folder, _, study, _, _ = finished
    assert "| default | corridor | 3 |" in (folder / "episode_table.md").read_text()
    assert len(study.sheets) == 4 and all(file.exists() for _, file in study.sheets)
    assert set(study.seconds) >= {"making tasks", "building policies", "running episodes", "figures, tables and sheets"}


def test_films_are_of_the_first_policy(finished):
    folder, maker, study, _, said = finished
    # Each is run by itself in the conditions of its batch.
    assert maker.runs[4:] == [(1, conditions_seed(0, walks, 0)) for walks in SETTINGS.episode_sets]
    if any("cannot draw" in sentence for sentence in said):
        pytest.skip("nothing to draw with")
    assert [title for title, _ in study.films] == ["default, corridor", "default, test_office"]
    assert all(file.stat().st_size > 1000 for _, file in study.films)
    # Only what is missing is filmed again.
    study.films[1][1].unlink()
    again, said = Maker(), []
    films = run_episode_study(SETTINGS, again, folder, FILM, say=said.append).films
    assert again.runs == [(1, conditions_seed(0, "test_office", 0))] and "Running 1 " in said[-1]
    assert films == study.films and films[1][1].exists()


def test_a_finished_study_is_not_run_again(finished):
    folder, _, study, _, _ = finished
    maker, said = Maker(), []
    again = run_episode_study(SETTINGS, maker, folder, None, say=said.append)
    assert maker.made == [] and "4 of 4 batches" in said[0]
    np.testing.assert_equal(again.groups, study.groups)
    assert len(again.sheets) == 4


def test_a_stopped_study_goes_on_where_it_was(finished, tmp_path):
    """Oracle: the study that was not stopped."""
    _, _, whole, _, _ = finished

    class Stopped(Maker):
        def __call__(self, policy, width, images):
            if policy == "classical":
                raise KeyboardInterrupt
            return super().__call__(policy, width, images)

    with pytest.raises(KeyboardInterrupt):
        run_episode_study(SETTINGS, Stopped(), tmp_path, None)
    assert "| classical |" not in (tmp_path / "episode_table.md").read_text()
    maker = Maker()
    study = run_episode_study(SETTINGS, maker, tmp_path, None)
    assert maker.made == [("classical", 3, False)]
    np.testing.assert_equal(study.groups, whole.groups)


def test_batches_are_kept_as_they_end_in_any_order(finished, tmp_path):
    """Oracle: the study whose batches ended in order."""
    _, _, whole, _, _ = finished

    class LastFirst(StubProgram):
        stopped = False

        def run_batches(self, batches, on_progress=lambda progress: None):
            for number, record in reversed(list(super().run_batches(batches, on_progress))):
                yield number, record
                if self.stopped:
                    raise KeyboardInterrupt

    class Stopped(LastFirst):
        stopped = True

    with pytest.raises(KeyboardInterrupt):
        run_episode_study(SETTINGS, lambda *_: Stopped(), tmp_path, None)
    said = []
    study = run_episode_study(SETTINGS, lambda *_: LastFirst(), tmp_path, None, say=said.append)
    assert "1 of 4 batches" in said[0]
    np.testing.assert_equal(study.groups, whole.groups)
    batch = episode_batches(SETTINGS, scheduled_episodes(SETTINGS))[1]
    for folder in (tmp_path, finished[0]):
        record = load_traces(traces_file(folder, SETTINGS, "default", batch))
        np.testing.assert_allclose(record.base[0, 0, :2], batch.episodes[0].task.start[:2], atol=0.05)


def test_other_sets_in_another_order_are_the_same_episodes(finished):
    """Oracle: the study of both sets."""
    folder, _, whole, _, _ = finished
    for names in (("test_office", "corridor"), ("test_office",)):
        maker = Maker()
        study = run_episode_study(dataclasses.replace(SETTINGS, episode_sets=names), maker, folder, None)
        assert maker.made == []
        np.testing.assert_equal(study.groups, {key: whole.groups[key] for key in whole.groups if key[1] in names})


def test_a_batch_that_is_partly_there_is_run_again(tmp_path):
    """Fewer episodes are in the folder already; of more, what is new; traces tell the same as the log."""
    settings = dataclasses.replace(SETTINGS, policies=("classical",), episode_sets=("corridor",), seeds=4, width=3)
    numbers = {}
    for seeds, run in ((4, [3, 1]), (3, []), (2, []), (5, [2]), (6, [3])):
        maker = Maker()
        chosen = dataclasses.replace(settings, seeds=seeds)
        episodes = run_episode_study(chosen, maker, tmp_path, None).groups["classical", "corridor"]
        assert [count for count, _ in maker.runs] == run
        for number, metrics in enumerate(episodes):
            np.testing.assert_equal(numbers.setdefault(number, metrics), metrics)
        for batch in episode_batches(chosen, scheduled_episodes(chosen)):
            record = load_traces(traces_file(tmp_path, chosen, "classical", batch))
            for i, episode in enumerate(batch.episodes):
                metrics = episode_metrics(row_of(record, i), episode.task, shortest=episodes[episode.number].shortest)
                assert metrics.outcome is episodes[episode.number].outcome
                assert metrics.walked == pytest.approx(episodes[episode.number].walked, rel=1e-6)


@pytest.mark.parametrize("damage", ["gone", "empty", "cut", "short"])
def test_a_batch_whose_traces_are_damaged_is_run_again(tmp_path, damage):
    settings = dataclasses.replace(SETTINGS, policies=("classical",))
    first = run_episode_study(settings, Maker(), tmp_path, None)
    batch = episode_batches(settings, scheduled_episodes(settings))[1]
    file = traces_file(tmp_path, settings, "classical", batch)
    if damage == "short":
        save_traces(file, make_record())
    else:
        content = file.read_bytes()
        file.unlink() if damage == "gone" else file.write_bytes(content[: len(content) // 2 * (damage == "cut")])
    maker = Maker()
    again = run_episode_study(settings, maker, tmp_path, None)
    assert maker.runs == [(3, conditions_seed(0, "test_office", 0))]
    np.testing.assert_equal(again.groups, first.groups)
    assert has_traces(file, 3) and not has_traces(file, 4)
    assert not list(file.parent.glob("*.part*"))


def test_what_a_robot_meets_depends_on_its_set_and_number_alone():
    """Oracle: the conditions themselves, drawn for batches of several studies."""
    robot = default_walker()[0].robot
    met = {}
    for names, seeds in ((("corridor", "test_office"), 3), (("test_office",), 2), (("factory", "test_office"), 5)):
        settings = StudySettings("p", episode_sets=names, seeds=seeds, width=3)
        for batch in episode_batches(settings, scheduled_episodes(settings)):
            conditions = sample_conditions(robot, Disturbances(), len(batch.episodes), batch.seed)
            for i, episode in enumerate(batch.episodes):
                own = (episode.task.start, float(conditions.friction[i]), *np.asarray(conditions.qpos[i]).tolist())
                assert met.setdefault((episode.episode_set, episode.number), own) == own
    assert len(set(met.values())) == len(met) == 3 + 5 + 5
    assert conditions_seed(0, "office", 0) != conditions_seed(1, "office", 0) != conditions_seed(1, "office", 20)


def test_other_settings_are_other_episodes(finished):
    folder, *_ = finished
    maker = Maker()
    other = StudySettings("pretrained", ("default",), ("corridor",), seeds=2, width=3, depth="ideal")
    study = run_episode_study(other, maker, folder, None)
    assert len(maker.runs) == 1 and list(study.groups) == [("default", "corridor")]


def test_studies_with_other_seeds_have_other_tasks():
    starts = [
        episode.task.start
        for seed in (0, 1)
        for episode in scheduled_episodes(StudySettings("p", episode_sets=("corridor",), seeds=2, seed=seed))
    ]
    assert len(set(starts)) == 4


def test_traces_are_what_pictures_need(tmp_path):
    record = make_record(images=True)
    save_traces(tmp_path / "new" / "a.npz", record)
    before, after = row_of(record, 0), row_of(load_traces(tmp_path / "new" / "a.npz"), 0)
    for name in ("time", "outcome", "base", "believed", "feet"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
    np.testing.assert_array_equal(after.path[-1], before.path[-1])
    assert after.depth.size == 0


class Page(HTMLParser):
    """Checks that tags close and collects what the page refers to."""

    def __init__(self) -> None:
        super().__init__()
        self.open, self.sources, self.cells = [], [], 0

    def handle_starttag(self, tag, attributes):
        self.sources += [value for name, value in attributes if name in ("src", "href")]
        self.cells += tag == "td"
        if tag not in ("meta", "img", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_the_report_needs_nothing_from_elsewhere(finished):
    folder, _, study, _, _ = finished
    page = write_report(folder, Report("Walks & <goals>", {"depth": "noisy"}, "a machine, 2 cores", study))
    parsed = Page()
    parsed.feed(page.read_text())
    assert parsed.open == [] and parsed.cells > 4 * 17
    pictures = [source for source in parsed.sources if source.startswith("data:image/png;base64,")]
    assert len(pictures) == 4
    for source in set(parsed.sources) - set(pictures):
        assert (folder / source).exists()
    text = page.read_text()
    assert "Walks &amp; &lt;goals&gt;" in text and "a machine, 2 cores" in text
    assert "its body touched an obstacle" in text
    markdown = (folder / "report.md").read_text()
    assert "| default | test_office | 2 | 1 |" in markdown and "Where the time went" in markdown


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"episode_sets": ("ballroom",)}, "ballroom.*factory"),
        ({"policies": ("default", "default")}, "once"),
        ({"policies": ()}, "choose each policy"),
        ({"count": 0}, "count"),
        ({"seed": -1}, "seed"),
        ({"seeds": 10_001}, "more than 10000"),
    ],
)
def test_bad_settings(options, words):
    with pytest.raises(InputError, match=words):
        StudySettings("pretrained", **options)
