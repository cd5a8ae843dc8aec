"""The planner's process: camera frames in one thread, footsteps in another, so that neither waits for the other."""

import os
import threading
import time
import traceback
from collections.abc import Mapping
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from iwalker_jax.deployment import loader
from iwalker_jax.deployment.live.deadlines import Deadlines
from iwalker_jax.deployment.live.messages import Arrays, Header, Kind, layouts_of
from iwalker_jax.deployment.live.process import DONE, READY, WatchdogLimits, ignore_interrupts, told_to_end
from iwalker_jax.deployment.live.sockets import CONTROLLER, PLANNER, ROBOT, Peer, newest

_IDLE = 0.05  # [s] of waiting for a message before it is looked whether to end


class _Frames:
    """Plans on the newest image, in a thread of its own."""

    def __init__(self, function: loader.Artifact, memory: Arrays, goals: Arrays, rate: float, peer: Peer) -> None:
        self.deadlines = Deadlines("Camera frames", rate)
        self.finished: float | None = None
        self.way: Arrays = {}
        self._function, self._memory, self._goals, self._peer = function, memory, goals, peer
        self._waiting: tuple[Header, Arrays] | None = None
        self._state: Arrays = {}
        self._changed = threading.Condition()
        self._ending = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def show(self, image: tuple[Header, Arrays], state: Arrays) -> None:
        """Plan on an image with the present state; one that still waits is left out."""
        with self._changed:
            self.deadlines.skip(self._waiting is not None)
            self._waiting, self._state = image, state
            self._changed.notify()

    def close(self) -> None:
        """Wait for the frame under way: a process that ends within one is aborted."""
        with self._changed:
            self._ending = True
            self._changed.notify()
        self._thread.join(5.0)

    def _run(self) -> None:
        try:
            while True:
                with self._changed:
                    while self._waiting is None and not self._ending:
                        self._changed.wait()
                    if self._ending or self._waiting is None:
                        return
                    (header, image), state = self._waiting, self._state
                    self._waiting = None
                outputs = self._function({**self._memory, **image, **state, **self._goals})
                way = {name: np.asarray(outputs[name]) for name in outputs if not name.startswith("memory.")}
                self._memory = outputs
                self.finished, self.way = time.monotonic(), way
                self.deadlines.answered(1e-9 * header.sent, self.finished)
                self._peer.send(ROBOT, Kind.SEEN, header.number, {})
        except BaseException:
            # A planner that cannot see is to be missed by the controller.
            traceback.print_exc()
            os._exit(1)


class _Footsteps:
    """Answers what the controller says of the body by a command."""

    def __init__(self, function: loader.Artifact, spot: Any, limits: WatchdogLimits) -> None:
        self._function, self._spot, self._limits = function, spot, limits
        self._number = 0
        self._command: Arrays = {}

    def command(self, body: Arrays, frames: _Frames) -> Arrays:
        """Footsteps, new or not."""
        way, finished = frames.way, frames.finished
        if not way:
            return self._sent(body, {name: body[name] for name in body if name.startswith("plan.")} | _STANDING)
        blind = finished is None or time.monotonic() - finished > self._limits.camera
        stop = np.bool_(blind or bool(way["stop"]))
        steps = self._function({**way, **body, "stop": stop, "spot": self._spot})
        steps = {name: np.asarray(array) for name, array in steps.items()}
        self._spot = steps["spot"]
        if steps["new"] or steps["plan.count"] != body["plan.count"] or not self._command:
            self._number += 1
            self._command = self._sent(body, steps)
        return self._command

    def _sent(self, body: Arrays, steps: Mapping[str, Any]) -> Arrays:
        plan = {f"command.{name}": array for name, array in steps.items() if name.startswith("plan.")}
        return {
            **plan,
            "command.number": np.int32(self._number),
            "command.stopping": steps["stopping"],
            "command.touchdowns": body["memory.touchdowns"],
        }


_STANDING: Arrays = {"plan.count": np.int32(0), "stopping": np.bool_(False)}


def run_planner(folder: Path, place: Path, limits: WatchdogLimits, goals: Arrays, supervisor: Connection) -> None:
    """Plan until told to end; then report.

    Args:
        folder: of the exported policy.
        place: of the sockets.
        limits: of silence.
        goals: `goals` and `goal_count` of the camera frame.
        supervisor: hears `READY`, and in the end `DONE` with the figures.
    """
    ignore_interrupts()
    loader.use_settings(folder)
    manifest = loader.read_manifest(folder)
    functions = loader.load(folder, ["start_frame", "frame", "footsteps"])
    _compile(functions, manifest)
    peer = Peer(place, PLANNER, layouts_of(manifest))
    rates = {name: manifest["functions"][name]["rate_hz"] for name in ("frame", "footsteps")}
    deadlines = Deadlines("Footsteps", rates["footsteps"])
    supervisor.send((READY, None))
    frames: _Frames | None = None
    footsteps: _Footsteps | None = None
    waiting: tuple[Header, Arrays] | None = None
    state: Arrays = {}
    while not told_to_end(supervisor):
        messages = peer.receive(_IDLE)
        body, image = newest(messages, Kind.BODY), newest(messages, Kind.IMAGE)
        if body is not None:
            state = {name: body[1][name] for name in ("qpos", "qvel")}
            if frames is None or footsteps is None:
                start = functions["start_frame"](state)
                frames = _Frames(functions["frame"], start, goals, rates["frame"], peer)
                footsteps = _Footsteps(functions["footsteps"], np.asarray(start["spot"]), limits)
            peer.send(CONTROLLER, Kind.COMMAND, body[0].number, footsteps.command(body[1], frames))
            deadlines.answered(1e-9 * body[0].sent, time.monotonic())
        waiting = image or waiting
        if waiting is not None and frames is not None:
            frames.show(waiting, state)
            waiting = None
    if frames is not None:
        frames.close()
    peer.close()
    report = {
        "punctuality": deadlines.punctuality(),
        "frames": None if frames is None else frames.deadlines.punctuality(),
        "refused": peer.refused,
    }
    supervisor.send((DONE, report))


def _compile(functions: Mapping[str, loader.Artifact], manifest: Mapping[str, Any]) -> None:
    """Call all functions once, of a robot that stands and sees nothing."""
    zeros = {
        name: np.zeros(entry["shape"], entry["dtype"])
        for function in ("frame", "footsteps")
        for name, entry in functions[function].inputs.items()
    }
    home = np.asarray(manifest["robot"]["home"], np.float32)
    standing = {**zeros, "qpos": home, "image.qpos": home}
    start = functions["start_frame"](standing)
    # As later: what goes from call to call stays with JAX, and all else comes from messages.
    functions["frame"]({**start, **standing, **{name: start[name] for name in start if name.startswith("memory.")}})
    functions["footsteps"](standing)
