"""The rows of both studies: what each of them changes, and that every one can be configured."""

import dataclasses

import pytest

from experiments import ablation, compare, low_level
from iwalker_jax.training.config import TrainConfig

DEFAULT = TrainConfig(epochs=8)


@pytest.mark.parametrize("study", [compare, ablation])
def test_labels_are_unique_and_start_from_earlier_rows(study):
    labels: list[str] = []
    for variant in study.variants(DEFAULT):
        assert variant.label not in labels
        assert variant.starts_from is None or variant.starts_from in labels
        assert variant.config.source == DEFAULT.source
        labels.append(variant.label)
    assert len(labels) >= 5


def test_baselines_and_planner_share_all_but_their_method():
    """Only the heuristic baselines have free waypoints; only fine-tuning and PPO have a rate of their own."""
    rows = {variant.label: variant.config for variant in compare.variants(DEFAULT)}
    assert rows["iwalker"] == rows["untrained"] == DEFAULT
    assert dataclasses.replace(rows["ppo"], method="iwalker", learning_rate=DEFAULT.learning_rate) == DEFAULT
    for label in ("iplanner", "finetuned"):
        assert rows[label].method == label
        assert not rows[label].planner.ipath.even
        assert rows[label].models == DEFAULT.models
    assert rows["iplanner"].epochs == rows["ppo"].epochs == DEFAULT.epochs


def test_ablations_change_one_thing():
    rows = {variant.label: variant.config for variant in ablation.variants(DEFAULT)}
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


def test_the_low_level_study_changes_its_terms_alone():
    rows = low_level.variants(low_level.Command(epochs=8))
    assert rows.pop("without") == DEFAULT and not DEFAULT.weights.ask_low_level
    for config in rows.values():
        assert config.weights.ask_low_level
        silent = dataclasses.replace(config.weights, torque_margin=0.0, shortfall=0.0, placement=0.0)
        assert dataclasses.replace(config, weights=silent) == DEFAULT
    assert rows["qp"] == dataclasses.replace(
        rows["all"], weights=dataclasses.replace(rows["all"].weights, placement=0.0)
    )


def test_differences_are_paired_by_task():
    """By hand: +2 and +4, and a task that has no value does not count."""
    column = low_level.COLUMNS[0]
    first, second = ([{column.title: value} for value in values] for values in ((1, 2, float("nan")), (3, 6, 1)))
    assert low_level.difference(first, second, column) == "+3.00 [+1.04, +4.96] (2)"
    assert low_level.difference(first[:1], second[:1], column) == "-"
