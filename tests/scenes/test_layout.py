"""The scene builder: overlap test, doorways, and furniture that stays on its footprint."""

import math

import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.scenes.built import furniture
from iwalker_jax.scenes.built.layout import TRAINING_STYLE, Furniture, Layout, Pose2D, Style

MAKERS = {
    "table": lambda layout: furniture.table(layout, 0.8, 1.4),
    "desk": lambda layout: furniture.desk(layout, 1.4),
    "chair": furniture.chair,
    "office_chair": furniture.office_chair,
    "shelf": lambda layout: furniture.shelf(layout, 1.0),
    "rack": lambda layout: furniture.rack(layout, 2.2, 0.8),
    "cabinet": lambda layout: furniture.cabinet(layout, 1.0, 0.4, 1.2),
    "sofa": lambda layout: furniture.sofa(layout, 1.8),
    "barrel": furniture.barrel,
    "pillar": furniture.pillar,
    "person": furniture.person,
    "bin": furniture.waste_bin,
    "clutter": furniture.clutter,
    "staircase": lambda layout: furniture.staircase(layout, 1.2, 8),
}


def new_layout(seed: int = 0) -> Layout:
    return Layout(np.random.default_rng(seed), TRAINING_STYLE, (0.0, 0.0, 10.0, 10.0))


def grid_in(place: Pose2D, length: float, width: float) -> np.ndarray:
    unit = np.linspace(-0.5, 0.5, 60)
    local = np.stack(np.meshgrid(unit * length, unit * width), -1).reshape(-1, 2)
    cos, sin = math.cos(place.yaw), math.sin(place.yaw)
    return local @ np.array([[cos, sin], [-sin, cos]]) + (place.x, place.y)


def inside(points: np.ndarray, place: Pose2D, length: float, width: float) -> np.ndarray:
    cos, sin = math.cos(place.yaw), math.sin(place.yaw)
    local = (points - (place.x, place.y)) @ np.array([[cos, -sin], [sin, cos]])
    return (abs(local[:, 0]) < length / 2) & (abs(local[:, 1]) < width / 2)


def test_free_rectangles_agree_with_sampled_overlap():
    """Oracle: dense samples of one rectangle tested against the other; grazing contacts are left out."""
    rng = np.random.default_rng(1)
    verdicts = []
    for _ in range(200):
        layout = new_layout()
        first = Pose2D(*rng.uniform(0, 2, 2), float(rng.uniform(-4, 4)))
        second = Pose2D(*rng.uniform(0, 2, 2), float(rng.uniform(-4, 4)))
        sizes = rng.uniform(0.3, 1.5, 4)
        layout.reserve(first, sizes[0], sizes[1])
        hits = inside(grid_in(second, sizes[2], sizes[3]), first, sizes[0], sizes[1]).sum()
        hits += inside(grid_in(first, sizes[0], sizes[1]), second, sizes[2], sizes[3]).sum()
        if hits == 0 or hits > 40:
            verdicts.append((layout.is_free(second, sizes[2], sizes[3], 0.0), bool(hits == 0)))
    wrong = sum(free != disjoint for free, disjoint in verdicts)
    assert wrong <= 2  # contacts thinner than the sampling
    assert 30 < sum(free for free, _ in verdicts) < len(verdicts) - 30


@pytest.mark.parametrize("name", MAKERS)
def test_furniture_stays_on_its_footprint_and_stands_on_the_floor(name):
    """Oracle: corners and rims of the parts, computed here from the finished scene."""
    for seed in range(5):
        layout = new_layout(seed)
        piece: Furniture = MAKERS[name](layout)
        at = Pose2D(4.0, 5.0, 0.9)
        assert layout.put(piece, at)
        assert not layout.put(piece, at.moved(0.05, 0.0))
        scene = layout.scene("t", "t")
        rims = [np.empty((0, 2))]
        for x, y, _, hx, hy, _, yaw in scene.boxes:
            rims.append(grid_in(Pose2D(x, y, yaw), 2 * hx, 2 * hy))
        for x, y, _, radius, _ in scene.cylinders:
            angle = np.linspace(0, 2 * math.pi, 50)
            rims.append(np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], 1))
        assert inside(np.concatenate(rims), at, piece.length + 1e-6, piece.width + 1e-6).all()
        lows = np.concatenate([scene.boxes[:, 2] - scene.boxes[:, 5], scene.cylinders[:, 2] - scene.cylinders[:, 4]])
        assert -1e-9 <= lows.min() <= 0.05


def test_doorway_has_its_width_a_lintel_and_clear_floor():
    """Oracle: the pieces of one wall measured along its axis."""
    layout = Layout(np.random.default_rng(0), Style(open_doors=0.0), (0.0, 0.0, 10.0, 10.0))
    layout.wall((1.0, 2.0), (5.0, 2.0), ((1.5, 0.9),))
    boxes = layout.scene("t", "t").boxes
    standing, lintel = boxes[boxes[:, 2] - boxes[:, 5] < 0.1], boxes[boxes[:, 2] - boxes[:, 5] > 1.5]
    intervals = sorted((x - h, x + h) for x, h in zip(standing[:, 0], standing[:, 3], strict=True))
    np.testing.assert_allclose(intervals, [(1.0, 2.05), (2.95, 5.0)], atol=1e-9)
    np.testing.assert_allclose((lintel[0, 0], 2 * lintel[0, 3]), (2.5, 0.9), atol=1e-9)
    np.testing.assert_allclose(lintel[0, 2] + lintel[0, 5], layout.ceiling)
    assert not layout.is_free(Pose2D(2.5, 2.6), 0.4, 0.4, 0.0)
    assert layout.is_free(Pose2D(4.2, 2.6), 0.4, 0.4, 0.0)


def test_open_doors_leave_the_doorway_free():
    """Oracle: points across the doorway and just before and behind it against the door's own rectangle."""
    seen = 0
    for seed in range(30):
        layout = Layout(np.random.default_rng(seed), Style(open_doors=1.0), (0.0, 0.0, 10.0, 10.0))
        layout.wall((1.0, 2.0), (5.0, 2.0), ((1.5, 0.9),))
        leaves = [box for box in layout.boxes if abs(math.sin(box[6])) > 0.1]
        points = np.stack(np.meshgrid(np.linspace(2.06, 2.94, 30), np.linspace(1.6, 2.4, 20)), -1).reshape(-1, 2)
        for x, y, _, hx, hy, _, yaw in leaves:
            seen += 1
            assert not inside(points, Pose2D(x, y, yaw), 2 * hx, 2 * hy).any()
            assert abs(hx - 0.45) < 1e-9
    assert seen == 30


@pytest.mark.parametrize("changes", [{"ceiling": (3.0, 2.0)}, {"door_width": (0.0, 1.0)}, {"open_doors": 1.5}])
def test_bad_styles_are_refused(changes):
    with pytest.raises(InputError, match="Style"):
        Style(**changes)
