#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A run with the force method on the arm's own, emulated processor.
usage: on_board_run_test.py SOURCE_FOLDER PROGRAM"""
import json
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

ROOT, PROGRAM = pathlib.Path(sys.argv[1]), sys.argv[2]
SECONDS = 5


class OnBoardRun(unittest.TestCase):
    def test_moves_the_arm_by_the_processors_forces(self):
        with tempfile.TemporaryDirectory() as folder:
            summary = pathlib.Path(folder) / "summary.json"
            done = subprocess.run(
                [str(ROOT / "examples/firmware/run_on_board.sh"), "rls", "small", PROGRAM,
                 "--no-config", "run", "--device", "emulated:woodenhaptics_v2015", "--seconds",
                 str(SECONDS), "--device-timeout-ms", "400", "--method", "hold", "--no-reference",
                 "--out", folder, "--json", str(summary)],
                cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=50)
            self.assertEqual(done.returncode, 0, done.stdout)
            self.assertRegex(done.stdout, r"Second processor: \d+ cycles, \d+ answered")
            emulator = json.loads(summary.read_text(encoding="utf-8"))["emulator"]
        core = emulator["core"]
        self.assertGreater(core["cycles"], 200 * (SECONDS - 3), emulator)
        # A machine that is busy answers late; an answer that is overtaken does not count.
        self.assertGreater(core["answers"], 0.2 * core["cycles"], emulator)
        self.assertEqual(core["broken_frames"], 0)
        # The host commands no current that counts: what flowed came from the processor.
        self.assertGreater(max(emulator["max_abs_current_mA"]), 200.0, emulator)


if __name__ == "__main__":
    if not (ROOT / "build/firmware/firmware_rls.elf").is_file() or not shutil.which("qemu-system-arm"):
        print("skipped: `make firmware` installs the emulator and builds the images")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1])
