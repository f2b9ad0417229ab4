#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What a person who watches a real run waits for, measured in the page, in headless Chromium
without a graphics card: how long a stop takes, how many pictures a second a large object has, and
how late pictures are, with the times of the page's parts and the browser's processor time.
usage: run_speed.py FORCEGRID stop [--runs N] [--scene SCENE]
       run_speed.py FORCEGRID pictures [--corners X,Y,Z] [--seconds S]
       run_speed.py FORCEGRID delay [--seconds S] [--scene SCENE]"""
import argparse
import os
import pathlib
import random
import re
import signal
import statistics
import sys
import tempfile
import time

import live_view_test
from live_view_test import Run, wait_until
from browser import start_browser

# From the time stamp of the key to the page's turn to handle it, to the text of the acknowledgement,
# and to the task after the frame that draws it.
TIMES = """
window.stop_times = {};
addEventListener('keydown', (event) => {
  stop_times.pressed ??= event.timeStamp;
  stop_times.handled ??= performance.now();
}, true);
const status = document.getElementById('stop-status');
new MutationObserver(() => {
  if (status.dataset.stop !== 'acknowledged' || stop_times.written) return;
  stop_times.written = performance.now();
  requestAnimationFrame(() => {
    const channel = new MessageChannel();
    channel.port1.onmessage = () => { stop_times.drawn = performance.now(); };
    channel.port2.postMessage(0);
  });
}).observe(status, {attributes: true, attributeFilter: ['data-stop']});
"""
BLOCK = """description = "Cube of 0.1 m with more vertices"
patch_radius_m = 0.012

[[object]]
shape = "block"
vertex_count = [%s]
size_m = [0.1, 0.1, 0.1]
stiffness_N_per_m = 5.0
diagonal_factor = 0.7
random_spread = 0.3
seed = 1
law = "hardening"
cubic_coefficient = 5.0
"""


def open_page(browser, run):
    browser.get(run.url)
    wait_until(lambda: browser.execute_script("return document.body.dataset.state") == "live",
               "a live page", run.lines)


def view(browser, name):
    return browser.execute_script(f"return window.forcegridView.{name}")


def press_space(browser):
    key = {"key": " ", "code": "Space", "text": " ", "windowsVirtualKeyCode": 32}
    for kind in ("keyDown", "keyUp"):
        browser.execute_cdp_cmd("Input.dispatchKeyEvent", {"type": kind, **key})


def begun_run(scene):
    """Another one if the first ends before it begins: a busy machine has no time for its device."""
    try:
        return Run("--seconds", "60", scene=scene)
    except AssertionError as error:
        print(f"a run did not begin, another one is tried: {error}", file=sys.stderr)
        return Run("--seconds", "60", scene=scene)


def one_stop(browser, scene, wait_s):
    """Milliseconds to the page's handling, to the written and to the drawn acknowledgement."""
    run = begun_run(scene)
    try:
        open_page(browser, run)
        wait_until(lambda: view(browser, "in_contact"), "contact", run.lines)
        browser.execute_script(TIMES)
        time.sleep(wait_s)
        press_space(browser)
        times = wait_until(lambda: browser.execute_script(
            "return window.stop_times.drawn && window.stop_times"), "the acknowledgement", run.lines)
        status = run.process.wait(live_view_test.PATIENCE_S)
        if status != 3:
            raise AssertionError(f"the run ended with {status}\n" + "\n".join(run.lines))
        return [times[what] - times["pressed"] for what in ("handled", "written", "drawn")]
    finally:
        run.close()


def at(share, values):
    """The smallest value that at least this share of them does not exceed."""
    return sorted(values)[max(0, -(-len(values) * share // 100) - 1)]


def measure_stops(browser, options):
    phases = random.Random(1)
    loads, all_ms = [], []
    for _ in range(options.runs):
        all_ms.append(one_stop(browser, options.scene, phases.uniform(0.3, 0.8)))
        loads.append(os.getloadavg()[0])
    for what, values in zip(("the page's handling of it", "the written acknowledgement",
                             "the drawn one"), zip(*all_ms)):
        print(f"stop, {options.scene}, {len(values)} runs, from the key to {what}: p50 {at(50, values):.1f} ms, p90 {at(90, values):.1f} ms, p99 "
              f"{at(99, values):.1f} ms, most {max(values):.1f} ms")
    print(f"load {min(loads):.1f} to {max(loads):.1f}")


def measure_pictures(browser, options, folder):
    scene = pathlib.Path(folder) / "large.toml"
    scene.write_text(BLOCK % ", ".join(options.corners.split(",")))
    corners = 1
    for count in options.corners.split(","):
        corners *= int(count)
    run = Run("--seconds", "0", "--motion", "lissajous", scene=str(scene))
    try:
        open_page(browser, run)
        wait_until(lambda: view(browser, "in_contact"), "contact", run.lines)
        time.sleep(8)  # until the picture's scale is found
        ask = ("const v = window.forcegridView;"
               "return [performance.now(), v.pictures, v.frames, v.render_scale, v.vertices]")
        before, pictures, frames = browser.execute_script(ask), [], []
        for _ in range(options.seconds):
            time.sleep(1)
            after = browser.execute_script(ask)
            pictures.append(1000 * (after[1] - before[1]) / (after[0] - before[0]))
            frames.append(1000 * (after[2] - before[2]) / (after[0] - before[0]))
            before = after
        if run.process.poll() is not None:
            raise AssertionError("the run has ended\n" + "\n".join(run.lines))
        measured = view(browser, "measured")
    finally:
        run.close()
    print(f"block of {corners} vertices, {after[4]} of them in its surface, 1280x720, scale "
          f"{after[3]:.2f}: {statistics.median(pictures):.1f} pictures/s at the median second, "
          f"{min(pictures):.1f} in the slowest; {statistics.median(frames):.1f} surface frames/s, "
          f"{min(frames):.1f} in the slowest; the simulator answers "
          f"{measured['arrivals_per_s']:.0f} times a second; load {os.getloadavg()[0]:.1f}")


def processor_s():
    """By kind of the browser's processes, the processor time that they have had."""
    seconds = {}
    for folder in pathlib.Path("/proc").glob("[0-9]*"):
        try:
            command = (folder / "cmdline").read_text()
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue  # it has ended
        kind = re.search(r"--type=([a-z-]+)", command)
        if "chrom" in command.split("\0")[0] and kind:
            ticks = int(fields[11]) + int(fields[12])
            seconds[kind[1]] = seconds.get(kind[1], 0) + ticks / os.sysconf("SC_CLK_TCK")
    return seconds


def measure_delay(browser, options):
    run = Run("--seconds", "0", "--evaluate", "forcegrid;hold", scene=options.scene)
    try:
        open_page(browser, run)
        wait_until(lambda: view(browser, "in_contact"), "contact", run.lines)
        view(browser, "clear_times()")
        before, begin_s = processor_s(), time.monotonic()
        time.sleep(options.seconds)
        passed_s, after, parts = time.monotonic() - begin_s, processor_s(), view(browser, "times")
        run.process.send_signal(signal.SIGINT)
        run.process.wait(live_view_test.PATIENCE_S)
        delay = run.summary()["picture_delay_ms"]
    finally:
        run.close()
    print(f"{options.scene}: from the start of a cycle to the report that it is drawn, "
          f"{delay['pictures']} pictures: p50 {delay['p50']:.1f} ms, p99 {delay['p99']:.1f} ms; "
          f"load {os.getloadavg()[0]:.1f}")
    for name, part in sorted(parts.items()):
        print(f"  {name:12} {part['times'] / passed_s:5.1f} a second, mean {part['mean_ms']:.2f} ms, "
              f"p99 {part['p99_ms']:.1f} ms, most {part['most_ms']:.1f} ms")
    used = {kind: 100 * (seconds - before.get(kind, 0)) / passed_s for kind, seconds in after.items()}
    print("  % of a core: " + ", ".join(f"{kind} {share:.1f}" for kind, share in sorted(used.items())
                                       if share >= 0.1))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("forcegrid")
    parser.add_argument("what", choices=("stop", "pictures", "delay"))
    parser.add_argument("--runs", type=int, default=100, help="one stop each")
    parser.add_argument("--scene", default="block")
    parser.add_argument("--corners", default="47,47,46", help="vertices along each edge")
    parser.add_argument("--seconds", type=int, default=20)
    options = parser.parse_args()
    live_view_test.FORCEGRID = options.forcegrid
    with tempfile.TemporaryDirectory() as folder:
        browser = start_browser(folder, full_rate=True)
        try:
            browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {
                "width": 1280, "height": 720, "deviceScaleFactor": 1, "mobile": False})
            if options.what == "stop":
                measure_stops(browser, options)
            elif options.what == "delay":
                measure_delay(browser, options)
            else:
                measure_pictures(browser, options, folder)
        finally:
            browser.quit()


if __name__ == "__main__":
    main()
