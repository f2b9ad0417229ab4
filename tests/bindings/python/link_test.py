#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The link's two ends in Python: with each other, and with the file of examples/."""
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest

import numpy as np

import forcegrid

ROOT = pathlib.Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT / "examples"))
import forcegrid_link  # noqa: E402

PATIENCE_S = 20.0
STIFFNESS = (-100, 0, 0, 0, -100, 0, 0, 0, -72)


class BothEnds:
    """Run for each simulator's end: both have the same interface."""

    def simulator(self, **options):
        raise NotImplementedError

    def with_both(self, key_files=(), **asking):
        simulator = self.simulator(host="127.0.0.1", port=0, key_files=list(key_files))
        self.addCleanup(simulator.close)
        servo = forcegrid.ServoLink("127.0.0.1:%d" % simulator.port, list(key_files),
                                     **asking)
        self.addCleanup(servo.close)
        return simulator, servo

    def tool_state(self, simulator, servo, position, **more):
        """Sends until the simulator's end has it: with a key, the first ones only introduce."""
        deadline_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline_s:
            number = servo.send_tool_state(time.monotonic_ns(), position, **more)
            news = simulator.receive(0.05)
            if news.tool_state:
                self.assertEqual(news.tool_state.sequence, number)
                return news
            servo.receive(0.0)
        self.fail("no tool state came")

    def test_make_the_round_trip(self):
        simulator, servo = self.with_both()
        news = self.tool_state(simulator, servo, (0.125, -0.0625, 0.03125),
                               velocity_W_m_per_s=(0.5, 0, -0.25))
        self.assertTrue(news.new_session)
        state = news.tool_state
        self.assertEqual(state.position_W_m, (0.125, -0.0625, 0.03125))
        self.assertEqual(state.velocity_W_m_per_s, (0.5, 0.0, -0.25))
        simulator.answer(state, (-1.5, 0.0, 2.25), in_contact=True, converged=True, contact_epoch=2,
                         contact_point_W_m=(0.125, -0.0625, 0.0), relative_residual=2**-10,
                         solve_time_s=1 / 64, stiffness_W_N_per_m=STIFFNESS)
        sample = servo.receive(PATIENCE_S)
        self.assertEqual(sample.echo_sequence, state.sequence)
        self.assertEqual(sample.force_W_N, (-1.5, 0.0, 2.25))
        self.assertEqual(sample.position_W_m, state.position_W_m)
        self.assertEqual(sample.contact_point_W_m, (0.125, -0.0625, 0.0))
        self.assertEqual(sample.stiffness_W_N_per_m, STIFFNESS)
        self.assertEqual((sample.in_contact, sample.converged, sample.contact_epoch,
                          sample.relative_residual, sample.solve_time_s, sample.query_id),
                         (True, True, 2, 2**-10, 1 / 64, 0))

    def test_tell_a_pose_and_a_torque(self):
        simulator, servo = self.with_both()
        turned = (0.5, 0.5, -0.5, 0.5)
        state = self.tool_state(simulator, servo, (0, 0, 0.5), orientation_WT=turned,
                                angular_velocity_W_rad_per_s=(0.25, -2, 0), buttons=5).tool_state
        self.assertEqual((state.has_orientation, state.has_buttons, state.buttons), (True, True, 5))
        self.assertEqual(state.orientation_WT, turned)
        self.assertEqual(state.angular_velocity_W_rad_per_s, (0.25, -2.0, 0.0))
        simulator.answer(state, (1, 0, 0), in_contact=True, converged=True,
                         torque_W_Nm=(1 / 32, -1 / 16, 0), rotational_stiffness_W_Nm_per_rad=STIFFNESS)
        sample = servo.receive(PATIENCE_S)
        self.assertEqual(sample.torque_W_Nm, (1 / 32, -1 / 16, 0.0))
        self.assertEqual(sample.orientation_WT, turned)
        self.assertEqual(sample.rotational_stiffness_W_Nm_per_rad, STIFFNESS)
        simulator.answer(state, (1, 0, 0), in_contact=True, converged=True)
        sample = servo.receive(PATIENCE_S)
        self.assertIsNone(sample.torque_W_Nm)
        self.assertIsNone(sample.rotational_stiffness_W_Nm_per_rad)
        for torque in ({"torque_W_Nm": (0, 2e3, 0)}, {"rotational_stiffness_W_Nm_per_rad": STIFFNESS},
                       {"torque_W_Nm": (0, 0, 0), "orientation_WT": (1, 1, 0, 0)}):
            with self.assertRaises(ValueError):
                simulator.answer(state, (1, 0, 0), in_contact=True, converged=True, **torque)
        for pose in ({"orientation_WT": (1, 1, 0, 0)}, {"orientation_WT": (1, 0, 0)},
                     {"angular_velocity_W_rad_per_s": (0, 1, 0)}):
            with self.assertRaises(ValueError):
                servo.send_tool_state(time.monotonic_ns(), (0, 0, 0), **pose)

    def test_tell_no_torque_without_a_wrist(self):
        simulator, servo = self.with_both()
        state = self.tool_state(simulator, servo, (0, 0, 0)).tool_state
        self.assertEqual((state.has_orientation, state.orientation_WT), (False, (1.0, 0.0, 0.0, 0.0)))
        simulator.answer(state, (1, 0, 0), in_contact=True, converged=True, torque_W_Nm=(0, 1, 0))
        sample = servo.receive(PATIENCE_S)
        self.assertIsNone(sample.torque_W_Nm)
        self.assertEqual(sample.force_W_N, (1.0, 0.0, 0.0))

    def test_answer_queries(self):
        simulator, servo = self.with_both()
        self.tool_state(simulator, servo, (0, 0, 0))
        number = servo.send_query(time.monotonic_ns(), (0.01, 0.02, 0.03))
        simulator.receive(PATIENCE_S)
        query = simulator.next_query()
        self.assertEqual((query.query_id, query.position_W_m), (number, (0.01, 0.02, 0.03)))
        self.assertIsNone(simulator.next_query())
        simulator.answer(query, (1, 2, 3), in_contact=True, converged=True)
        sample = servo.receive(PATIENCE_S)
        self.assertEqual((sample.query_id, sample.force_W_N), (number, (1.0, 2.0, 3.0)))
        self.assertIsNone(sample.stiffness_W_N_per_m)

    def test_say_goodbye(self):
        simulator, servo = self.with_both()
        state = self.tool_state(simulator, servo, (0, 0, 0)).tool_state
        simulator.answer(state, (0, 0, 0), in_contact=False, converged=True)
        self.assertIsNotNone(servo.receive(PATIENCE_S))
        self.assertFalse(servo.simulator_ended)
        servo.close()
        self.assertTrue(simulator.receive(PATIENCE_S).servo_ended)
        simulator.answer(state, (0, 0, 0), in_contact=False, converged=True)  # to nobody
        other = forcegrid.ServoLink("127.0.0.1:%d" % simulator.port)
        self.addCleanup(other.close)
        state = self.tool_state(simulator, other, (0, 0, 0)).tool_state
        simulator.close()
        deadline_s = time.monotonic() + PATIENCE_S
        while not other.simulator_ended and time.monotonic() < deadline_s:
            other.receive(0.05)
        self.assertTrue(other.simulator_ended)

    def test_refuse_what_the_servo_would_refuse(self):
        simulator, servo = self.with_both()
        state = self.tool_state(simulator, servo, (0, 0, 0)).tool_state
        for bad in ((float("nan"), 0, 0), (2e3, 0, 0)):
            with self.assertRaises(ValueError):
                simulator.answer(state, bad, in_contact=True, converged=True)

    def patch(self, servo):
        """The next patch that has come; receive() comes across it."""
        deadline_s = time.monotonic() + PATIENCE_S
        while (patch := servo.next_patch()) is None and time.monotonic() < deadline_s:
            servo.receive(0.02)
        return patch

    # All numbers are sums of few powers of two, so that they pass through 32-bit floats unchanged.
    def test_show_a_surface(self):
        simulator, servo = self.with_both()
        state = self.tool_state(simulator, servo, (0.125, -0.0625, 0.03125)).tool_state
        self.assertIsNone(servo.next_patch())
        a = 1 / 128
        square = [(0.125 - a, -0.0625 - a, 0.0), (0.125 + a, -0.0625 - a, 0.0),
                  (0.125 + a, -0.0625 + a, 0.0), (0.125 - a, -0.0625 + a, 0.0)]
        simulator.show_surface(state, square, [(0, 1, 2), (0, 2, 3)], contact_epoch=4,
                               tool_radius_m=a / 2, tool_length_m=1 / 16,
                               stiffness_W_N_per_m=(-10, -20, -300.5, 0.5, 0, -0.25))
        patch = self.patch(servo)
        self.assertEqual((patch.echo_sequence, patch.echo_servo_time_ns, patch.contact_epoch),
                         (state.sequence, state.servo_time_ns, 4))
        self.assertEqual(patch.position_W_m, state.position_W_m)
        self.assertEqual(patch.vertices_W_m, tuple(square))
        self.assertEqual(patch.triangles, ((0, 1, 2), (0, 2, 3)))
        self.assertEqual((patch.tool_radius_m, patch.tool_length_m, patch.tool_opening_rad),
                         (a / 2, 1 / 16, 0.0))
        self.assertEqual(patch.stiffness_W_N_per_m, (-10.0, -20.0, -300.5, 0.5, 0.0, -0.25))
        self.assertIsNone(patch.press_forces_W_N)
        self.assertEqual(servo.patches_accepted, 1)
        self.assertIsNone(servo.next_patch())
        with self.assertRaises(ValueError):
            simulator.show_surface(state, square, [(0, 1, 4)])

    def test_show_a_surface_to_a_grasper_that_slides(self):
        simulator, servo = self.with_both()
        state = self.tool_state(simulator, servo, (0, 0, 0.5)).tool_state
        presses = ((0.0, 0.0, 0.125), (0.0, 0.0625, 0.5))
        simulator.show_surface(state, [(0, 0, 0), (1 / 64, 0, 0), (0, 1 / 64, 0)], [(0, 1, 2)],
                               tool_radius_m=1 / 256, tool_length_m=1 / 8,
                               press_forces_W_N=presses, tool_opening_rad=0.25)
        patch = self.patch(servo)
        self.assertEqual(patch.press_forces_W_N, presses)
        self.assertIsNone(patch.stiffness_W_N_per_m)
        self.assertEqual(patch.tool_opening_rad, 0.25)
        # A second patch for the same tool state is a duplicate.
        simulator.show_surface(state, [], [])
        deadline_s = time.monotonic() + PATIENCE_S
        while not servo.dropped.get("duplicated") and time.monotonic() < deadline_s:
            servo.receive(0.02)
        self.assertEqual(servo.dropped.get("duplicated"), 1)
        # The newest replaces those that were not fetched; it says that nothing is near.
        for z_m in (0.25, 0.125):
            state = self.tool_state(simulator, servo, (0, 0, z_m)).tool_state
            simulator.show_surface(state, [], [], contact_epoch=2)
        while servo.patches_accepted < 3 and time.monotonic() < deadline_s:
            servo.receive(0.02)
        patch = servo.next_patch()
        self.assertEqual((patch.position_W_m, patch.vertices_W_m, patch.triangles),
                         ((0.0, 0.0, 0.125), (), ()))
        self.assertEqual((patch.tool_radius_m, patch.contact_epoch), (0.0, 2))

    def test_share_a_key(self):
        with tempfile.TemporaryDirectory() as folder:
            key = str(pathlib.Path(folder, "link.key"))
            subprocess.run([os.environ["FORCEGRID_PROGRAM"], "--no-config", "keygen", key],
                           check=True, capture_output=True)
            simulator, servo = self.with_both([key])
            state = self.tool_state(simulator, servo, (0, 0, 0.5)).tool_state
            simulator.answer(state, (0, 0, 1), in_contact=True, converged=True)
            self.assertEqual(servo.receive(PATIENCE_S).force_W_N, (0.0, 0.0, 1.0))


class Package(BothEnds, unittest.TestCase):
    def simulator(self, **options):
        return forcegrid.SimulatorLink(**options)

    def test_takes_numpy_arrays(self):
        simulator, servo = self.with_both()
        state = self.tool_state(simulator, servo, np.array((0.1, 0, 0))).tool_state
        simulator.answer(state, np.array((1.0, 2.0, 3.0)), in_contact=True, converged=True,
                         stiffness_W_N_per_m=np.reshape(STIFFNESS, (3, 3)))
        self.assertEqual(servo.receive(PATIENCE_S).stiffness_W_N_per_m, STIFFNESS)

    def test_needs_no_numpy(self):
        program = ("import sys, time, forcegrid\n"
                   "a = forcegrid.SimulatorLink(port=0)\n"
                   "b = forcegrid.ServoLink('127.0.0.1:%d' % a.port)\n"
                   "b.send_tool_state(time.monotonic_ns(), (0, 0, 0))\n"
                   "state = a.receive(10).tool_state\n"
                   "a.answer(state, [0, 0, 1], True, True, stiffness_W_N_per_m=[0] * 9)\n"
                   "sys.exit(b.receive(10).force_W_N != (0.0, 0.0, 1.0) or 'numpy' in sys.modules)")
        subprocess.run([sys.executable, "-c", program], check=True, timeout=PATIENCE_S + 10)

    def test_gives_the_whole_path(self):
        simulator, servo = self.with_both()
        self.tool_state(simulator, servo, (0, 0, 0))
        for i in range(1, 6):
            servo.send_tool_state(time.monotonic_ns(), (0.01 * i, 0, 0))
        simulator.receive(PATIENCE_S)
        path = []
        while (state := simulator.next_tool_state()) is not None:
            path.append(round(100 * state.position_W_m[0]))
        self.assertEqual(path, [0, 1, 2, 3, 4, 5])

    def test_waits_without_the_gil(self):
        simulator, servo = self.with_both()
        for wait in (simulator.receive, servo.receive):
            turns, over = [0], threading.Event()

            def turn():
                while not over.is_set():
                    turns[0] += 1
                    time.sleep(1e-3)
            other = threading.Thread(target=turn)
            other.start()
            wait(0.3)
            over.set()
            other.join()
            self.assertGreater(turns[0], 20)

    def test_waits_no_longer_than_ctrl_c(self):
        for wait in ("forcegrid.SimulatorLink(port=0).receive(60)",
                     "forcegrid.ServoLink('127.0.0.1:9').receive(60)"):
            waiting = subprocess.Popen(
                [sys.executable, "-c", "import forcegrid; print('up', flush=True); " + wait],
                stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
            waiting.stdout.readline()
            time.sleep(0.2)
            waiting.send_signal(signal.SIGINT)
            _, said = waiting.communicate(timeout=PATIENCE_S)
            self.assertIn("KeyboardInterrupt", said)

    def test_errors_name_the_input(self):
        with self.assertRaisesRegex(forcegrid.LinkError, "10.0.0.1"):
            forcegrid.SimulatorLink("10.0.0.1", 0)
        with self.assertRaisesRegex(forcegrid.LinkError, "nowhere"):
            forcegrid.ServoLink("nowhere:24870")
        with self.assertRaisesRegex(forcegrid.LinkError, "no.key"):
            forcegrid.ServoLink("127.0.0.1:24870", ["no.key"])
        simulator, servo = self.with_both()
        with self.assertRaisesRegex(ValueError, "position_W_m: expected three numbers"):
            servo.send_tool_state(1, (0, 0))
        with self.assertRaisesRegex(ValueError, "the tool state is not finite"):
            servo.send_tool_state(1, (float("inf"), 0, 0))
        with self.assertRaisesRegex(ValueError, "timeout_s"):
            simulator.receive(-1)
        simulator.close()
        with self.assertRaisesRegex(forcegrid.LinkError, "closed"):
            simulator.receive(0)

    def test_tell_how_the_torque_changes_with_the_place_if_asked(self):
        for asks in (True, False):
            simulator, servo = self.with_both(sensitivities=asks)
            state = self.tool_state(simulator, servo, (0, 0, 0.5), orientation_WT=(1, 0, 0, 0)).tool_state
            simulator.answer(state, (1, 0, 0), in_contact=True, converged=True,
                             torque_W_Nm=(0, 1, 0), torque_gradient_W_N=STIFFNESS)
            sample = servo.receive(PATIENCE_S)
            self.assertEqual(sample.torque_gradient_W_N, STIFFNESS if asks else None)
            with self.assertRaises(ValueError):
                simulator.answer(state, (1, 0, 0), in_contact=True, converged=True,
                                 torque_gradient_W_N=STIFFNESS)


class LooseFile(BothEnds, unittest.TestCase):
    def simulator(self, **options):
        return forcegrid_link.SimulatorLink(**options)


if __name__ == "__main__":
    unittest.main()
