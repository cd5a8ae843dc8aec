"""Local maps against scenes of known geometry: free, occupied and unknown are where a ray caster says they are."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.perception.camera import CameraMount, Intrinsics
from iwalker_jax.perception.collision_map import DEFAULT_OBSTACLES
from iwalker_jax.perception.grid import DEFAULT_GRID, GridSpec
from iwalker_jax.perception.local_map import BLIND_DISC_RADIUS, build_local_map, frame_cells
from tests.perception.box_scene import render

INTRINSICS = Intrinsics()
MOUNT = CameraMount()
TILTED = CameraMount(height=0.62, pitch=np.deg2rad(18.9), roll=np.deg2rad(10.4))
ROOM = [
    (4.0, 4.2, -4.0, 4.0, 0.0, 2.5),
    (2.0, 2.5, -0.6, 0.1, 0.0, 1.2),
    (1.5, 1.53, 0.6, 0.63, 0.0, 0.7),
]

build = jax.jit(build_local_map, static_argnames=("intrinsics", "grid", "obstacles"))


def _sight_line_is_blocked(camera: np.ndarray, target: np.ndarray) -> bool:
    """Whether a straight line over the floor crosses one of ROOM's boxes, by sampling it each 5 mm."""
    steps = int(np.linalg.norm(target - camera) / 0.005) + 2
    line = camera + np.linspace(0.0, 1.0, steps)[:, None] * (target - camera)
    return any(
        bool(((line[:, 0] > x0) & (line[:, 0] < x1) & (line[:, 1] > y0) & (line[:, 1] < y1)).any())
        for x0, x1, y0, y1, _, _ in ROOM
    )


@pytest.mark.parametrize("mount", [MOUNT, TILTED])
def test_free_and_unknown_are_where_sight_lines_say(mount):
    """Oracle: straight sight lines through the scene's own boxes."""
    local = build(render(INTRINSICS, mount, ROOM), mount.as_array(), INTRINSICS)
    centres = np.asarray(DEFAULT_GRID.centres()).reshape(-1, 2)
    free, unknown = np.asarray(local.known_free).ravel(), np.asarray(local.unknown).ravel()
    occupied = np.asarray(local.occupied).ravel()
    camera = np.array([mount.forward, mount.left])
    bearing = np.arctan2(centres[:, 1] - camera[1], centres[:, 0] - camera[0])
    distance = np.linalg.norm(centres - camera, axis=1)
    sampled = np.random.default_rng(0).permutation(len(centres))[:4000]
    blocked = np.array([_sight_line_is_blocked(camera, centres[i]) for i in sampled])
    shallow = np.array([_sight_line_is_blocked(camera, centres[i] * 1.06) for i in sampled])
    in_view = np.abs(bearing[sampled]) < np.deg2rad(38)
    seen = in_view & ~blocked & ~shallow & (distance[sampled] < 3.8)
    assert seen.sum() > 400 and free[sampled][seen].mean() > 0.97
    hidden = blocked & ~occupied[sampled] & (distance[sampled] > BLIND_DISC_RADIUS + 0.2)
    assert hidden.sum() > 400 and unknown[sampled][hidden].mean() > 0.97
    behind = (np.abs(bearing) > np.deg2rad(75)) & (distance > BLIND_DISC_RADIUS + 0.1)
    assert unknown[behind].all()


def test_floor_seen_over_a_low_box_is_free():
    """A 0.2 m high box hides a short stretch only; the floor seen beyond it is free though its bearing is blocked."""
    depth = render(INTRINSICS, MOUNT, [(1.5, 1.6, -0.5, 0.5, 0.0, 0.2)])
    local = build(depth, MOUNT.as_array(), INTRINSICS)
    row = round((1.525 - DEFAULT_GRID.x_min) / 0.05 - 0.5)
    assert np.asarray(local.occupied)[row, 72:88].all()
    far = np.asarray(local.known_free)[row + 24 : row + 34, 76:84]
    hidden = np.asarray(local.unknown)[row + 4 : row + 10, 76:84]
    assert far.mean() > 0.15 and hidden.all()


@pytest.mark.parametrize("wall", [[], [(4.5, 4.7, -9.0, 9.0, -0.5, 2.0)]], ids=["open", "wall opposite"])
def test_a_drop_is_not_free(wall):
    """A stairwell beyond 2 m, 0.3 m deep, also when a wall is seen across it: none of its cells is free floor."""
    landing, well = (-1.0, 2.0, -5.0, 5.0, -0.1, 0.0), (-9.0, 20.0, -20.0, 20.0, -0.5, -0.3)
    depth = render(INTRINSICS, MOUNT, [landing, well, *wall], floor=False)
    local = build(depth, MOUNT.as_array(), INTRINSICS)
    assert np.asarray(local.known_free)[40:54, 70:90].all()
    assert not np.asarray(local.known_free)[60:, :].any()


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf, -1.0, 60.0, 0.05, 0.3, 1.0])
def test_useless_and_blocked_frames_give_valid_maps(value):
    depth = np.full((90, 160), value, np.float32)
    local = build(depth, MOUNT.as_array(), INTRINSICS)
    for array in local:
        assert np.isfinite(np.asarray(array, np.float32)).all()
    classes = np.stack([local.occupied, local.known_free, local.unknown]).astype(int)
    np.testing.assert_array_equal(classes.sum(0), 1)
    centres = np.asarray(DEFAULT_GRID.centres())
    far = np.linalg.norm(centres, axis=-1) > 2.5
    assert np.asarray(local.unknown)[far].all()
    assert np.asarray(local.occupied).any() == (value in (0.05, 0.3, 1.0))


def test_a_batch_row_does_not_depend_on_its_neighbours():
    depths = np.stack([render(INTRINSICS, m, ROOM) for m in (MOUNT, TILTED)] + [np.zeros((90, 160), np.float32)])
    mounts = np.stack([MOUNT.as_array(), TILTED.as_array(), MOUNT.as_array()])
    batched = jax.jit(jax.vmap(lambda d, m: build_local_map(d, m, INTRINSICS)))(depths, mounts)
    for k in range(3):
        single = build(depths[k], mounts[k], INTRINSICS)
        for ours, expected in zip(batched[:3], single[:3]):
            assert np.mean(np.asarray(ours[k]) != np.asarray(expected)) < 1e-3
        np.testing.assert_allclose(batched.published[k], single.published, atol=0.03)


@pytest.mark.parametrize("shape", [(90,), (1, 160), (160, 90), (2, 90, 160)])
def test_a_depth_image_of_another_size_is_refused(shape, unchecked_types):
    with pytest.raises(InputError, match="90 rows and 160 columns"):
        build(np.ones(shape, np.float32), MOUNT.as_array(), INTRINSICS)


def test_any_grid_and_image_size():
    intrinsics = Intrinsics(320, 180, 160.0, 160.0, 159.5, 89.5)
    grid = GridSpec(x_min=0.0, y_min=-3.0, resolution=0.1, rows=50, columns=60)
    local = build(render(intrinsics, MOUNT, ROOM), MOUNT.as_array(), intrinsics, grid)
    assert local.occupied.shape == local.esdf.shape == (50, 60)
    assert np.asarray(local.occupied)[40].mean() > 0.4


def test_real_frames_give_floor_ahead(real_depth_folder):
    """Real frames through the documented mount: most of the first two metres ahead is free, something is occupied."""
    import cv2

    from iwalker_jax.perception.depth_cleanup import depth_from_uint16

    intrinsics = Intrinsics(640, 480, 383.8, 383.8, 321.7, 236.8)
    for name in ("000028.png", "000084.png"):
        raw = cv2.imread(str(real_depth_folder / name), cv2.IMREAD_UNCHANGED)
        local = build(depth_from_uint16(raw, 0.001), TILTED.as_array(), intrinsics)
        assert np.asarray(local.known_free)[24:40, 76:84].mean() > 0.5
        assert 20 < np.asarray(local.occupied).sum() < 3000


@pytest.mark.parametrize(
    ("depth", "mount", "sentence"),
    [
        (np.full((90, 160), 2000.0, np.float32), MOUNT.as_array(), "millimetres"),
        (np.full((90, 160), 2.0, np.float32), [0.58, 15.0, 0.0, 0.0, 0.0], "pitch is 15.0 rad"),
        (np.full((90, 160), 2.0, np.float32), [0.58], "shape"),
    ],
)
def test_millimetres_and_degrees_are_recognised_outside_jit(depth, mount, sentence, unchecked_types):
    with pytest.raises(InputError, match=sentence):
        build_local_map(depth, np.array(mount, np.float32), INTRINSICS)


def test_what_lies_below_the_view_is_presumed_free_and_not_seen_to_be():
    """Oracle: geometry; the image's lower edge meets the floor h / tan(pitch + half the view) ahead of the camera."""
    depth = jnp.asarray(render(INTRINSICS, MOUNT, ROOM))
    cells = frame_cells(depth, MOUNT.as_array(), INTRINSICS, DEFAULT_GRID, DEFAULT_OBSTACLES)
    lower_edge = MOUNT.pitch + np.arctan((INTRINSICS.height - 1 - INTRINSICS.cy) / INTRINSICS.fy)
    first = MOUNT.forward + MOUNT.height / np.tan(lower_edge)
    x, y = np.moveaxis(np.asarray(DEFAULT_GRID.centres()), -1, 0)
    ahead = (np.abs(y) < 0.3 * x) & (np.abs(y) < 0.3)
    below = ahead & (x > 0.1) & (x < first - 0.05)
    assert np.asarray(cells.known_free)[below].all() and not np.asarray(cells.seen_free)[below].any()
    seen = ahead & (x > first + 0.08) & (x < 1.8)
    assert np.asarray(cells.seen_free)[seen].all()
    assert not np.asarray(cells.seen_free & ~cells.known_free).any()
