"""Videos: files that OpenCV and Pillow read again, pictures that show the motion, sentences for what goes wrong."""

import ctypes
import os
import subprocess
import sys

import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.film.headless import configure_rendering
from iwalker_jax.geometry import Side

configure_rendering()

import cv2  # noqa: E402
import mujoco  # noqa: E402
from PIL import Image  # noqa: E402

from iwalker_jax.film.rendering import Ending, Overlays, VideoSettings, render_frames  # noqa: E402
from iwalker_jax.film.video import play_motion, write_frames, write_video  # noqa: E402
from iwalker_jax.walking import TimedFootsteps  # noqa: E402

BOX = """
<mujoco>
  <visual><headlight ambient="0.9 0.9 0.9" diffuse="0 0 0" specular="0 0 0"/></visual>
  <default>
    <default class="unseen"><geom size="0.001" rgba="0 0 0 0" contype="0" conaffinity="0" mass="0"/></default>
  </default>
  <worldbody>
    <geom type="plane" size="0 0 1" rgba="0.5 0.5 0.5 1"/>
    <camera name="still" pos="0 0 3" xyaxes="1 0 0 0 1 0"/>
    <body name="base" pos="0 0 0.2">
      <freejoint/>
      <camera name="side" mode="track" pos="0 0 2.8" xyaxes="1 0 0 0 1 0"/>
      <geom type="box" size="0.1 0.1 0.1" rgba="1 0 1 1"/>
      <body pos="0 -0.3 0"> <site name="midfoot_r"/>
        <site name="toe_r" pos="0.3 0 0"/> <geom class="unseen" name="toe_r" pos="0.3 0 0"/>
        <site name="heel_r" pos="-0.3 0 0"/> <geom class="unseen" name="heel_r" pos="-0.3 0 0"/>
      </body>
      <body pos="0 0.3 0"> <site name="midfoot_l"/>
        <site name="toe_l" pos="0.3 0 0"/> <geom class="unseen" name="toe_l" pos="0.3 0 0"/>
        <site name="heel_l" pos="-0.3 0 0"/> <geom class="unseen" name="heel_l" pos="-0.3 0 0"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
SMALL = VideoSettings(width=160, height=120, fps=10.0)


@pytest.fixture(scope="module")
def box() -> mujoco.MjModel:
    """A magenta box on a floor, seen from above, x to the right and y up in the picture."""
    return mujoco.MjModel.from_xml_string(BOX)


@pytest.fixture(scope="module")
def drawing(box) -> None:
    """Tests that draw are skipped on machines that cannot."""
    try:
        next(render_frames(box, *sliding(box), SMALL))
    except InputError as error:
        pytest.skip(str(error))


def sliding(model: mujoco.MjModel, speed: float = 0.4, seconds: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """qpos and times of the base sliding along x at 500 Hz."""
    times = np.linspace(0.0, seconds, round(500 * seconds) + 1)
    qpos = np.tile(model.qpos0, (len(times), 1))
    qpos[:, 0] += speed * times
    return qpos, times


def pixels(image: np.ndarray, rgb: tuple[float, float, float]) -> np.ndarray:
    """(n, 2) row and column of pixels whose hue is near a colour's; shading changes the rest."""
    hsv = cv2.cvtColor(image, cv2.COLOR_RGB2HSV).astype(float)
    hue = cv2.cvtColor(np.uint8([[np.asarray(rgb) * 255]]), cv2.COLOR_RGB2HSV)[0, 0, 0]
    return np.argwhere((np.abs(hsv[..., 0] - hue) < 6) & (hsv[..., 1] > 120) & (hsv[..., 2] > 60))


@pytest.mark.parametrize(("suffix", "slow_motion", "count"), [("mp4", 1.0, 11), ("mp4", 2.0, 21), ("webm", 1.0, 11)])
def test_opencv_reads_the_film(drawing, box, tmp_path, capfd, suffix, slow_motion, count):
    file = tmp_path / "new" / f"walk.{suffix}"
    settings = VideoSettings(width=160, height=120, fps=10.0, slow_motion=slow_motion)
    assert write_video(file, box, *sliding(box), settings) == count
    capture = cv2.VideoCapture(str(file))
    frames = []
    while (answer := capture.read())[0]:
        frames.append(answer[1])
    assert len(frames) == count and frames[0].shape == (120, 160, 3)
    assert capture.get(cv2.CAP_PROP_FPS) == pytest.approx(10.0)
    assert capfd.readouterr().err == ""


def test_the_last_instant_is_shown_and_says_how_it_ended(drawing, box):
    """Oracle: the pinhole's place of the box at the end, which no whole number of frames leads to; a bar of colour."""
    still = VideoSettings(camera="still", width=160, height=120, fps=10.0)
    motion = sliding(box, seconds=0.95)
    frames = [
        image.copy() for image in render_frames(box, *motion, still, Overlays(ending=Ending("Fell", (200, 30, 40))))
    ]
    assert len(frames) == 10 + 15
    focal = 60.0 / np.tan(np.radians(45.0) / 2)
    moved = pixels(frames[-1], (1, 0, 1))[:, 1].mean() - pixels(frames[0], (1, 0, 1))[:, 1].mean()
    assert moved == pytest.approx(0.38 * focal / 2.7, abs=1.0)
    assert (np.median(frames[-1][:14].reshape(-1, 3), axis=0) == (200, 30, 40)).all()
    assert not (frames[9][:14] == (200, 30, 40)).all(axis=2).any()


def test_the_legend_names_what_is_drawn(drawing, box):
    """Oracle: marks of each colour in the lower left corner, where nothing else is."""
    qpos, times = sliding(box)
    forces = np.zeros((len(times), 4, 3))
    legend = Overlays(forces=forces, legend=True)
    settings = VideoSettings(camera="still", width=640, height=480, fps=1.0)
    shown, plain = (next(render_frames(box, qpos, times, settings, each)) for each in (legend, Overlays(forces=forces)))
    corner = shown[400:, :60]
    assert len(pixels(corner, (0.1, 0.65, 0.25))) > 50 and len(pixels(corner, (0.85, 0.1, 0.1))) == 0
    np.testing.assert_array_equal(shown[:400], plain[:400])


def test_pillow_reads_the_gif_and_its_time_is_real(drawing, box, tmp_path):
    """30 frames a second cannot be told to a GIF: they become 25, and one second still lasts one second."""
    settings = VideoSettings(width=160, height=120, fps=30.0)
    assert write_video(tmp_path / "walk.gif", box, *sliding(box), settings) == 26
    with Image.open(tmp_path / "walk.gif") as image:
        assert image.size == (160, 120) and image.n_frames == 26
        assert image.info["duration"] == 40
        image.seek(25)
        last = np.asarray(image.convert("RGB"))
    expected = list(render_frames(box, *sliding(box), VideoSettings(width=160, height=120, fps=25.0)))[-1]
    assert np.abs(last.astype(float) - expected).mean() < 6.0


def test_the_picture_moves_with_the_robot(drawing, box):
    """Oracle: pinhole projection of the box's top into the still camera; a tracking camera keeps it centred."""
    settings = VideoSettings(camera="still", width=160, height=120, fps=10.0)
    still = list(render_frames(box, *sliding(box), settings))
    columns = [pixels(image, (1, 0, 1))[:, 1].mean() for image in still]
    focal = 60.0 / np.tan(np.radians(45.0) / 2)
    expected = 0.04 * focal / (3.0 - 0.3) * np.arange(11)
    np.testing.assert_allclose(np.subtract(columns, columns[0]), expected, atol=1.0)
    for image in render_frames(box, *sliding(box), SMALL):
        assert pixels(image, (1, 0, 1)).mean(axis=0) == pytest.approx((59.5, 79.5), abs=1.0)


def test_a_robot_that_stands_gives_equal_frames_but_for_the_clock(drawing, box):
    frames = list(render_frames(box, *sliding(box, speed=0.0), SMALL))
    for image in frames[1:]:
        np.testing.assert_array_equal(image[20:], frames[0][20:])
    assert (frames[0][:20] != frames[5][:20]).any()


def test_footsteps_forces_and_pushes_are_drawn_where_they_are(drawing, box):
    """Left footsteps are blue at +y, which is up; the next one is larger; green forces and red pushes can be seen."""
    qpos, times = sliding(box, speed=0.0)
    steps = TimedFootsteps(
        np.array([0.5, 5.0]), np.array([[0.5, 0.4], [0.5, -0.4]]), np.zeros(2), np.array([Side.LEFT, Side.RIGHT])
    )
    forces = np.zeros((len(times), 4, 3))
    forces[:, 1] = (-40.0, 0.0, 10.0)
    pushes = np.zeros((len(times), 3))
    pushes[times > 0.7, 1] = -40.0
    settings = VideoSettings(width=640, height=480, fps=2.0)
    frames = list(render_frames(box, qpos, times, settings, Overlays(steps, forces, pushes, "caption")))
    blue, orange = pixels(frames[0], (0.12, 0.47, 0.71)), pixels(frames[0], (1.0, 0.5, 0.05))
    assert len(blue) > 1.3 * len(orange) > 0  # the left foot is next
    assert blue[:, 0].mean() < 239.5 < orange[:, 0].mean() and min(blue[:, 1].min(), orange[:, 1].min()) > 319.5
    assert len(pixels(frames[2], (1.0, 0.5, 0.05))) > 1.3 * len(orange)  # now the right one
    green = pixels(frames[0], (0.1, 0.65, 0.25))
    assert len(green) > 20 and green[:, 0].mean() > 239.5 and green[:, 1].mean() < 319.5
    red = (0.85, 0.1, 0.1)
    assert len(pixels(frames[0], red)) == 0 and len(pixels(frames[2], red)) > 20
    assert pixels(frames[2], red)[:, 0].mean() < 239.5  # a push to the right comes from the left


def nan_motion(model):
    qpos, times = sliding(model)
    qpos[7, 2] = np.nan
    return qpos, times


@pytest.mark.parametrize(
    ("motion", "settings", "overlays", "words"),
    [
        (nan_motion, {}, {}, "row 7"),
        (lambda m: (sliding(m)[0][:, :3], sliding(m)[1]), {}, {}, r"\(N, 7\)"),
        (lambda m: (sliding(m)[0], -sliding(m)[1]), {}, {}, "increase"),
        (sliding, {"camera": "roof"}, {}, "no camera 'roof'.*still, side"),
        (sliding, {}, {"forces": np.zeros((3, 4, 3))}, r"\(501, 4, 3\)"),
        (sliding, {}, {"pushes": np.zeros(3)}, r"\(501, 3\)"),
    ],
)
def test_bad_motions_cameras_and_overlays_leave_no_file(box, tmp_path, motion, settings, overlays, words):
    with pytest.raises(InputError, match=words):
        write_video(tmp_path / "walk.mp4", box, *motion(box), VideoSettings(**settings), Overlays(**overlays))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", ["webm", "mp4", "gif"])
@pytest.mark.parametrize("error", [KeyboardInterrupt, InputError])
def test_an_interrupted_film_leaves_nothing_and_keeps_the_one_before(tmp_path, suffix, error):
    def frames(broken):
        for k in range(8):
            if broken and k == 4:
                raise error("stopped")
            yield np.full((48, 64, 3), 30 * k, np.uint8)

    file = tmp_path / f"film.{suffix}"
    with pytest.raises(error):
        write_frames(file, frames(broken=True), 10.0)
    assert list(tmp_path.iterdir()) == []
    assert write_frames(file, frames(broken=False), 10.0) == 8
    whole = file.read_bytes()
    with pytest.raises(error):
        write_frames(file, frames(broken=True), 10.0)
    assert list(tmp_path.iterdir()) == [file] and file.read_bytes() == whole


@pytest.mark.parametrize(
    "options", [{"width": 161}, {"height": 0}, {"fps": 0.0}, {"slow_motion": -1.0}, {"samples": 3}]
)
def test_bad_settings(options):
    with pytest.raises(InputError, match=next(iter(options)).replace("samples", "anti-aliasing")):
        VideoSettings(**options)


def test_an_unknown_suffix(box, tmp_path):
    with pytest.raises(InputError, match=r"'\.avi'; use \.mp4, \.webm or \.gif"):
        write_video(tmp_path / "walk.avi", box, *sliding(box))


@pytest.mark.parametrize("suffix", ["mp4", "webm", "gif"])
def test_a_file_that_cannot_be_written(drawing, box, tmp_path, suffix):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be written"):
        write_video(tmp_path / "file" / f"walk.{suffix}", box, *sliding(box), SMALL)


_DRAW = f"""
import sys
from iwalker_jax.film.headless import configure_rendering
configure_rendering()
import mujoco, numpy
from iwalker_jax.errors import InputError
from iwalker_jax.film.video import write_video
model = mujoco.MjModel.from_xml_string('''{BOX}''')
try:
    write_video(sys.argv[1], model, numpy.tile(model.qpos0, (2, 1)), numpy.array([0.0, 1.0]))
except InputError as error:
    print(error)
"""


@pytest.mark.parametrize(
    "variables",
    [{"MUJOCO_GL": "disable"}, {"MUJOCO_GL": "glfw"}, {"MUJOCO_GL": "egl", "MUJOCO_EGL_DEVICE_ID": "99"}],
    ids=["disabled", "no screen", "no device"],
)
@pytest.mark.skipif(sys.platform != "linux", reason="the backends are Linux's")
def test_nothing_to_draw_with_is_said_in_one_sentence(tmp_path, variables):
    if variables["MUJOCO_GL"] == "egl":
        try:
            ctypes.CDLL("libEGL.so.1")
        except OSError:
            pytest.skip("EGL is not on this machine")
    hidden = ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL", "PYOPENGL_PLATFORM")
    environment = {name: value for name, value in os.environ.items() if name not in hidden} | variables
    run = subprocess.run(
        [sys.executable, "-c", _DRAW, str(tmp_path / "walk.mp4")], env=environment, capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith("MuJoCo cannot draw on this machine (") and run.stdout.count("\n") == 1
    assert "libegl1" in run.stdout and list(tmp_path.iterdir()) == []


def test_no_screen_for_the_viewer(box, monkeypatch):
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(InputError, match="no screen for MuJoCo's viewer"):
        play_motion(box, *sliding(box))


@pytest.mark.parametrize(
    ("screen", "own", "libraries", "chosen"),
    [
        (None, None, ("libEGL.so.1", "libOSMesa.so.8"), "egl"),
        (None, None, ("libOSMesa.so.8",), "osmesa"),
        (None, None, (), None),
        (None, "osmesa", ("libEGL.so.1",), "osmesa"),
        (":0", None, ("libEGL.so.1",), None),
    ],
    ids=["egl first", "osmesa else", "neither", "the user's own", "a screen"],
)
def test_the_backend_that_is_chosen(monkeypatch, screen, own, libraries, chosen):
    def load(name):
        if name not in libraries:
            raise OSError(name)

    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(ctypes, "CDLL", load)
    monkeypatch.delitem(sys.modules, "mujoco")
    for name, value in (("DISPLAY", screen), ("WAYLAND_DISPLAY", None), ("MUJOCO_GL", own)):
        monkeypatch.delenv(name, raising=False) if value is None else monkeypatch.setenv(name, value)
    with monkeypatch.context():
        configure_rendering()
        assert os.environ.get("MUJOCO_GL") == chosen
        if own is None:
            os.environ.pop("MUJOCO_GL", None)


def test_choosing_after_mujoco_was_imported(monkeypatch):
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(RuntimeError, match="call it first"):
        configure_rendering()
