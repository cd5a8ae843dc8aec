"""The controller's process: every state is answered by torques, whatever becomes of the planner."""

import gc
import math
import time
from collections.abc import Mapping
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from iwalker_jax.deployment import loader
from iwalker_jax.deployment.live.deadlines import Deadlines
from iwalker_jax.deployment.live.messages import Arrays, Header, Kind, layouts_of
from iwalker_jax.deployment.live.process import (
    CONTROLLER_PRIORITY,
    DONE,
    READY,
    WatchdogLimits,
    ignore_interrupts,
    prefer,
    told_to_end,
)
from iwalker_jax.deployment.live.sockets import CONTROLLER, PLANNER, ROBOT, Peer, newest

_IDLE = 0.05  # [s] of waiting for a state before it is looked whether to end
_LOOK = 50  # states from one such look to the next


def run_controller(folder: Path, place: Path, limits: WatchdogLimits, supervisor: Connection) -> None:
    """Answer states until told to end; then report.

    Args:
        folder: of the exported policy.
        place: of the sockets.
        limits: of silence.
        supervisor: hears `READY`, and in the end `DONE` with the figures.
    """
    ignore_interrupts()
    loader.use_settings(folder)
    real_time = limits.priority and prefer(CONTROLLER_PRIORITY)
    import jax

    # A tick is shorter than it takes another thread to wake up for it.
    jax.config.update("jax_cpu_enable_async_dispatch", False)
    manifest = loader.read_manifest(folder)
    controller = _Controller(loader.load(folder, ["start_control", "control"]), manifest, limits)
    peer = Peer(place, CONTROLLER, layouts_of(manifest))
    # A collection of garbage takes longer than a tick.
    gc.collect()
    gc.freeze()
    gc.disable()
    supervisor.send((READY, None))
    while True:
        messages = peer.receive(_IDLE)
        if (not messages or controller.answers % _LOOK == 0) and told_to_end(supervisor):
            break
        controller.hear(messages, peer)
    peer.close()
    report = {"real_time": real_time, "halts": controller.halts, "refused": peer.refused}
    supervisor.send((DONE, {**report, "punctuality": controller.deadlines.punctuality()}))


class _Controller:
    """The controller between its messages.

    Attributes:
        deadlines: of its answers.
        answers: given so far; halts: times that it lost the planner.
    """

    def __init__(
        self, functions: Mapping[str, loader.Artifact], manifest: Mapping[str, Any], limits: WatchdogLimits
    ) -> None:
        import jax

        rates = {name: manifest["functions"][name]["rate_hz"] for name in ("control", "footsteps")}
        self._device_put = jax.device_put
        self.deadlines = Deadlines("Controller", rates["control"])
        self.answers = self.halts = 0
        self._functions, self._limits = functions, limits
        self._per_check = round(rates["control"] / rates["footsteps"])
        self._heard = -math.inf  # [s] when the planner last was
        self._halted = True
        # Compiled before anybody waits.
        standing = standing_state(manifest)
        self._memory = functions["start_control"](standing)
        # What seldom changes is handed to JAX once, not at every tick.
        self._number = 0
        self._command = self._device_put(no_command(self._memory))
        self._halt = {halted: self._device_put(np.bool_(halted)) for halted in (False, True)}
        functions["control"]({**self._memory, **standing, **self._command, "halt": self._halt[True]})
        self._last: int | None = None

    def hear(self, messages: list[tuple[Header, Arrays]], peer: Peer) -> None:
        """Heed the newest command, answer the newest state, and show the planner the body when that is due."""
        command, state = newest(messages, Kind.COMMAND), newest(messages, Kind.STATE)
        if command is not None:
            self._heard = time.monotonic()
            if int(command[1]["command.number"]) != self._number:
                self._number = int(command[1]["command.number"])
                self._command = self._device_put(command[1])
        if state is None:
            return
        header, measured = state
        if self._last is None:
            self._memory = self._functions["start_control"](measured)
        else:
            self.deadlines.skip(max(header.number - self._last - 1, 0))
        self._last = header.number
        silent = time.monotonic() - self._heard > self._limits.planner
        self.halts += silent and not self._halted
        self._halted = silent
        control = self._functions["control"]
        arrays = {**self._memory, **measured, **self._command, "halt": self._halt[silent]}
        self._memory = control.call({name: arrays[name] for name in control.inputs})
        shown = {name: np.asarray(self._memory[name]) for name in ("torques", "clock.mode", "fallen")}
        peer.send(ROBOT, Kind.TORQUES, header.number, {**shown, "halted": silent})
        self.deadlines.answered(1e-9 * header.sent, time.monotonic())
        self.answers += 1
        if header.number % self._per_check == 0:
            peer.send(PLANNER, Kind.BODY, header.number, _body(self._memory, measured))


def standing_state(manifest: Mapping[str, Any]) -> Arrays:
    """The state of a robot that stands at the origin as its model does."""
    home = np.asarray(manifest["robot"]["home"], np.float32)
    velocities = np.zeros(manifest["functions"]["control"]["inputs"]["qvel"]["shape"], np.float32)
    return {"qpos": home, "qvel": velocities, "touching": np.ones(2, bool)}


def no_command(memory: Arrays) -> Arrays:
    """A command of no footsteps, from the memory of a controller that has begun."""
    arrays: dict[str, Any] = {
        f"command.plan.{name.rpartition('.')[2]}": np.asarray(array)
        for name, array in memory.items()
        if name.startswith("memory.plan.")
    }
    none = np.zeros((), np.int32)
    return {**arrays, "command.number": none, "command.stopping": np.bool_(False), "command.touchdowns": none}


def _body(memory: Arrays, measured: Arrays) -> Arrays:
    """What the planner is to know."""
    clock = {name: memory[name] for name in memory if name.startswith("clock.")}
    plan = {name.removeprefix("memory."): memory[name] for name in memory if name.startswith("memory.plan.")}
    rest = {"stopping": memory["memory.stopping"], "memory.touchdowns": memory["memory.touchdowns"]}
    return {**measured, **clock, **plan, **rest}
