"""The rows of both studies: what each of them changes, and that every one can be configured."""

import dataclasses

import pytest

from iwalker_jax.commands import ablation, compare, evaluate, train, whole_body_study
from iwalker_jax.commands.shared import training_study as study
from iwalker_jax.training.config import TrainConfig
from tests.experiments.commands import fails_with_one_sentence

DEFAULT = TrainConfig(epochs=8)


@pytest.mark.parametrize("variants_of", [compare.method_variants, ablation.ablation_variants])
def test_labels_are_unique_and_start_from_earlier_rows(variants_of):
    labels: list[str] = []
    for variant in variants_of(DEFAULT):
        assert variant.label not in labels
        assert variant.starts_from is None or variant.starts_from in labels
        assert variant.config.source == DEFAULT.source
        labels.append(variant.label)
    assert len(labels) >= 5


def test_baselines_and_planner_share_all_but_their_method():
    """Only the heuristic baselines have free waypoints; only fine-tuning and PPO have a rate of their own."""
    rows = {variant.label: variant.config for variant in compare.method_variants(DEFAULT)}
    assert rows["iwalker"] == rows["untrained"] == DEFAULT
    assert dataclasses.replace(rows["ppo"], method="iwalker", learning_rate=DEFAULT.learning_rate) == DEFAULT
    for label in ("iplanner", "finetuned"):
        assert rows[label].method == label
        assert not rows[label].planner.ipath.even
        assert rows[label].models == DEFAULT.models
    assert rows["iplanner"].epochs == rows["ppo"].epochs == DEFAULT.epochs


def test_ablations_change_one_thing():
    rows = {variant.label: variant.config for variant in ablation.ablation_variants(DEFAULT)}
    assert rows.pop("implicit") == DEFAULT
    for label, config in rows.items():
        changed = [
            field.name
            for field in dataclasses.fields(TrainConfig)
            if getattr(config, field.name) != getattr(DEFAULT, field.name)
        ]
        assert len(changed) == 1, label
    assert not rows["apart"].weights.step_to_path
    assert rows["published-map"].weights.published_collision > 0 == rows["published-map"].weights.step_collision


def test_the_whole_body_study_changes_its_terms_alone():
    rows = whole_body_study.weight_variants(whole_body_study.Command(epochs=8))
    assert rows.pop("without") == DEFAULT and not DEFAULT.weights.uses_whole_body
    for config in rows.values():
        assert config.weights.uses_whole_body
        silent = dataclasses.replace(config.weights, torque_margin=0.0, shortfall=0.0, placement=0.0)
        assert dataclasses.replace(config, weights=silent) == DEFAULT
    assert rows["qp"] == dataclasses.replace(
        rows["all"], weights=dataclasses.replace(rows["all"].weights, placement=0.0)
    )


def test_differences_are_paired_by_task():
    """By hand: +2 and +4, and a task that has no value does not count."""
    column = whole_body_study.COLUMNS[0]
    first, second = ([{column.title: value} for value in values] for values in ((1, 2, float("nan")), (3, 6, 1)))
    assert whole_body_study.difference(first, second, column) == "+3.00 [+1.04, +4.96] (2)"
    assert whole_body_study.difference(first[:1], second[:1], column) == "-"


@pytest.mark.parametrize(
    ("command", "options", "words"),
    [
        (compare, ["--seeds", "0"], "--seeds is 0; give at least 1"),
        (ablation, ["--unseen-scenes", "-1"], "--unseen-scenes is -1; give at least 0"),
        (train, ["--unseen-scenes", "-1"], "--unseen-scenes"),
        (evaluate, ["--unseen-scenes", "-1"], "--unseen-scenes"),
        (whole_body_study, ["--policy", "psychic"], "psychic"),
        (whole_body_study, ["--tasks", "0"], "--tasks"),
    ],
)
def test_what_would_fail_late_is_refused_at_once(tmp_path, capsys, monkeypatch, command, options, words):
    """Property: one sentence before any frame is made."""
    for module in (study, train, whole_body_study):
        monkeypatch.setattr(module, "prepare_data", lambda config: pytest.fail("work was begun"))
    run = lambda: command.main([*options, "--out", str(tmp_path / "out")])  # noqa: E731
    assert words in fails_with_one_sentence(run, capsys)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", [compare, whole_body_study, train])
def test_a_stopped_command_says_how_to_go_on(tmp_path, capsys, monkeypatch, command):
    def stopped(config):
        raise KeyboardInterrupt

    for module in (study, train, whole_body_study):
        monkeypatch.setattr(module, "prepare_data", stopped)
    assert command.main(["--out", str(tmp_path)]) == 130
    assert "Stopped; the same command goes on" in capsys.readouterr().out
