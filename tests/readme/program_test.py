#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The README's Python program, as it stands there, is the simulator of a short run.
usage: program_test.py SOURCE_FOLDER FORCEGRID"""
import json
import pathlib
import re
import socket
import subprocess
import sys
import tempfile
import unittest

ROOT, PROGRAM = pathlib.Path(sys.argv[1]), sys.argv[2]
PORT = "24870"  # as written in the README


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as trial:
        trial.bind(("127.0.0.1", 0))
        return str(trial.getsockname()[1])


class PythonProgram(unittest.TestCase):
    def test_is_felt_by_the_emulated_hand(self):
        text = (ROOT / "README.md").read_text(encoding="utf-8")
        programs = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
        self.assertEqual(len(programs), 1)
        self.assertIn(PORT, programs[0])
        self.assertLessEqual(len(programs[0].splitlines()), 17, "the README promises seventeen lines")
        port = free_port()
        with tempfile.TemporaryDirectory() as folder:
            simulator = subprocess.Popen([sys.executable, "-c", programs[0].replace(PORT, port)], cwd=ROOT)
            try:
                ran = subprocess.run(
                    [PROGRAM, "--no-config", "run", "--simulator", "127.0.0.1:" + port, "--seconds", "3",
                     "--device-timeout-ms", "400",
                     "--json", folder + "/run.json", "--out", folder], capture_output=True, text=True,
                    timeout=100)
                self.assertEqual(ran.returncode, 0, ran.stdout + ran.stderr)
                self.assertIsNone(simulator.poll(), "the simulator ended")
            finally:
                simulator.kill()
                simulator.wait()
            summary = json.loads(pathlib.Path(folder, "run.json").read_text(encoding="utf-8"))
        self.assertGreater(summary["samples_taken"], 50)
        self.assertGreater(sum(summary["rendered_status_cycles"].values()), 100, "never in contact")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
