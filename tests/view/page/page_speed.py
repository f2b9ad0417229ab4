#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""How many surface frames a second the page shows in headless Chromium without a graphics card.
usage: page_speed.py [--vertices N] [--seconds S] [--fixed-scale]"""
import argparse
import os
import pathlib
import statistics
import tempfile
import time

from browser import start_browser
from stand_in_server import StandIn


def processor_s():
    """Processor time [s] of this program's Chromium, by the kind of its processes."""
    used = {}
    for folder in pathlib.Path("/proc").glob("[0-9]*"):
        try:
            words = (folder / "cmdline").read_text().replace("\0", " ").split()
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        kind = next((word[7:] for word in words if word.startswith("--type=")), None)
        if kind and os.getsid(int(folder.name)) == os.getsid(0):
            ticks = int(fields[11]) + int(fields[12])
            used[kind] = used.get(kind, 0) + ticks / os.sysconf("SC_CLK_TCK")
    return used


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--vertices", type=int, default=10000)
    parser.add_argument("--seconds", type=int, default=20)
    parser.add_argument("--fixed-scale", action="store_true", help="always all pixels")
    options = parser.parse_args()
    stand_in = StandIn(options.vertices)
    with tempfile.TemporaryDirectory() as folder:
        browser = start_browser(folder, full_rate=True)
        try:
            browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {
                "width": 1280, "height": 720, "deviceScaleFactor": 1, "mobile": False})
            browser.get(stand_in.address)
            time.sleep(6)  # one round of the tool, and the picture's scale
            if options.fixed_scale:
                browser.execute_script("window.forcegridView.fix_scale(1)")
                time.sleep(2)
            frames, pictures = [], []
            ask = ("const v = window.forcegridView;"
                   "return [performance.now(), v.frames, v.pictures, v.render_scale, v.vertices]")
            before, used = browser.execute_script(ask), processor_s()
            first = before
            for _ in range(options.seconds):
                time.sleep(1)
                after = browser.execute_script(ask)
                frames.append(1000 * (after[1] - before[1]) / (after[0] - before[0]))
                pictures.append(after[2] - before[2])
                before = after
            shown = max(1, before[2] - first[2])
            cost = {kind: 1000 * (now - used.get(kind, 0)) / shown
                    for kind, now in processor_s().items()}
        finally:
            browser.quit()
            stand_in.close()
    print(f"{after[4]} vertices, 1280x720, scale {after[3]:.2f}: {statistics.median(frames):.1f} "
          f"surface frames/s at the median second, {min(frames):.1f} in the slowest; processor "
          f"{cost.get('gpu-process', 0):.0f} ms drawing + {cost.get('renderer', 0):.0f} ms page "
          f"per picture; load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
