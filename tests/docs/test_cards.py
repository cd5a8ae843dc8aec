"""Model card and data card against what ships and what the defaults make; figures against the page of results."""

import jax
from flax import nnx

from iwalker_jax.data import CameraPathSampling
from iwalker_jax.data.sources import DataConfig
from iwalker_jax.perception import Intrinsics
from iwalker_jax.scenes import FAMILIES
from iwalker_jax.training.pretrained import PRETRAINED, load_planner
from tests.docs.pages import ROOT


def rows_of(card: str) -> list[str]:
    lines = (ROOT / "docs" / card).read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line.startswith("| ") and not line.startswith("| ---")]


def facts_of(card: str) -> dict[str, str]:
    """The first table, by its names."""
    cells = [[cell.strip() for cell in row.strip("|").split("|")] for row in rows_of(card)]
    return {cell[0]: cell[1] for cell in cells if len(cell) == 2}


def test_the_model_card_describes_the_planner_that_ships():
    planner, config = load_planner()
    facts, ipath = facts_of("model_card.md"), config.planner.ipath
    assert facts["file"].startswith(f"`{PRETRAINED.relative_to(ROOT)}`")
    assert facts["parameters"].startswith(
        f"{sum(leaf.size for leaf in jax.tree.leaves(nnx.state(planner, nnx.Param)))},"
    )
    assert f"variant {ipath.variant}, {ipath.waypoints} waypoints" in facts["networks"]
    assert f"{config.planner.steps.count} footsteps" in facts["networks"]
    assert facts["image"].startswith(f"{ipath.camera.width} x {ipath.camera.height} px")
    assert facts["image"].endswith(f"focal length {ipath.camera.fx:g} px")
    assert facts["method"] == f"{config.method}, gradient {config.gradient}"
    assert facts["frames"].startswith(f"{config.source.frames} generated, and") and config.source.episodes is not None
    assert facts["last training"] == (
        f"{config.epochs} epochs, batches of {config.batch_size}, learning rate {config.learning_rate:g}"
    )


def test_figures_of_the_model_card_are_those_of_the_results():
    results = set((ROOT / "docs" / "results.md").read_text(encoding="utf-8").splitlines())
    figures = [row for row in rows_of("model_card.md") if row.count("|") > 3]
    assert len(figures) == 8 and set(figures) <= results


def test_the_data_card_describes_what_the_defaults_generate():
    facts, source, sampling, camera = facts_of("data_card.md"), DataConfig(), CameraPathSampling(), Intrinsics()
    assert facts["frames"].startswith(f"{source.frames} ") and f"seed {source.seed} " in facts["frames"]
    assert facts["scenes"].startswith(f"{len(FAMILIES)} families")
    assert facts["images"].startswith(f"{camera.width} x {camera.height} px")
    assert facts["camera paths"] == (
        f"{sampling.frames_per_path} frames on a route of {sampling.min_route:g} to {sampling.max_route:g} m"
    )
    assert facts["goals"] == f"{sampling.goals_per_frame} a frame, within {sampling.goal_radius:g} m"
