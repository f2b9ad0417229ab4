# SPDX-License-Identifier: Apache-2.0
"""What a typed program does with the package. Only mypy reads it: stubs_test.py."""
import time

import numpy as np
from numpy.typing import NDArray

import forcegrid
from forcegrid import LinkError, SimulatorLink


def spring(state: forcegrid.State) -> NDArray[np.float64]:
    return np.array(-200.0 * state.position_D_m)


def feel(url: str) -> str:
    with forcegrid.Device(url, rate_Hz=500.0, emulator_motion="lissajous") as device:
        device.enable_force()
        calls: int = device.run(spring, seconds=1.0)
        device.run(lambda state: (0.0, 0.0, -1.0 * state.position_D_m[2]), seconds=1.0)
        device.command_force([0.0, 0.0, 1.0])
        device.command_force(np.zeros(3, np.float32))
        state = device.read()
        while device.wait(state.cycle) and device.health == forcegrid.Health.RUNNING:
            device.read(out=state)
        return f"{calls} {state.position_D_m.copy()} {device.failure} {device.profile.name}"


def learn() -> NDArray[np.float64]:
    method = forcegrid.make("auto", cells=(8, 8, 8), nug=1e-6)
    epoch: int = method.contact_made((0.0, 0.0, 0.0))
    method.take_sample(0.0, np.zeros(3), (0.0, 0.0, 1.0), stiffness_W_N_per_m=-100.0 * np.eye(3))
    request = method.plan_request(0.0, (0.0, 0.0, 0.001))
    if request is not None:
        method.take_sample(0.0, request, np.zeros(3), from_query=True)
    assert epoch > 0 and method.work(1000) >= 0
    return method.force(np.arange(4) / 500.0, np.zeros((4, 3)))


def touch(link: SimulatorLink) -> int:
    news = link.receive(timeout_s=1 / 30)
    if news.tool_state is not None:
        x, y, z = news.tool_state.position_W_m
        link.answer(news.tool_state, [-100.0 * x, -100.0 * y, -100.0 * z], in_contact=True,
                    converged=True, contact_epoch=1)
        link.show_surface(news.tool_state, np.zeros((3, 3)), [(0, 1, 2)])
    while (query := link.next_query()) is not None:
        link.answer(query, np.zeros(3), in_contact=True, converged=True)
    return sum(link.dropped.values())


def ask(simulator: str) -> tuple[float, float, float] | None:
    with forcegrid.ServoLink(simulator, key_files=["link.key"]) as link:
        link.send_tool_state(time.monotonic_ns(), (0.0, 0.0, 0.01))
        sample = link.receive(timeout_s=0.1)
        patch = link.next_patch()
        if patch is not None and patch.press_forces_W_N is not None:
            return patch.press_forces_W_N[0]
        return sample.force_W_N if sample else None


def look(file: str) -> float:
    with forcegrid.Recording(file) as run:
        times = run["cycles/time_s"]
    figures = forcegrid.evaluate("auto", file, forces=True)
    pose = forcegrid.Kinematics("vintage").forward((2000, -1500, 1200))
    torque = pose.jacobian_D_m_per_rad.T @ np.ones(3)
    return float(times[-1]) + float(figures["rms"]) + float(torque[0])


def main() -> None:
    try:
        touch(SimulatorLink("127.0.0.1", 0, silence_s=1.0))
    except LinkError as error:
        print(error.strerror, forcegrid.__version__)
