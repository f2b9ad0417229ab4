#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""examples/forcegrid_link.py against the worked datagrams of docs/link_protocol.md."""
import pathlib
import re
import socket
import struct
import sys
import tempfile
import unittest
import unittest.mock
import zlib

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(ROOT / "examples"))
import forcegrid_link  # noqa: E402

SERVO_STREAM, SIMULATOR_STREAM = bytes(range(0x20, 0x30)), bytes(range(0x30, 0x40))


def worked_datagrams():
    """name -> bytes, from the blocks after a line "worked NAME"."""
    found, name = {}, None
    for line in (ROOT / "docs/link_protocol.md").read_text(encoding="utf-8").splitlines():
        match = re.match(r"worked (\w+)", line)
        if match:
            name = match.group(1)
        elif name and re.fullmatch(r"[0-9a-f]{4}  (?:[0-9a-f]{2} ?)+", line):
            found[name] = found.get(name, b"") + bytes.fromhex(line[6:])
    return found


WORKED = worked_datagrams()


class WithALink(unittest.TestCase):
    key_files = ()

    def setUp(self):
        self.link = forcegrid_link.SimulatorLink("127.0.0.1", 0, key_files=self.key_files)
        self.servo = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.servo.bind(("127.0.0.1", 0))
        self.servo.settimeout(20)

    def tearDown(self):
        self.link.close()
        self.servo.close()

    def send(self, datagram):
        self.servo.sendto(datagram, ("127.0.0.1", self.link.port))
        return self.link.receive(0.2)


class PlainLink(WithALink):
    def test_reads_the_worked_tool_state_and_query(self):
        state = self.send(WORKED["tool_state"]).tool_state
        self.assertEqual(state.sequence, 7)
        self.assertEqual(state.servo_time_ns, 1_500_000_000)
        self.assertEqual(state.position_W_m, (0.125, -0.0625, 0.03125))
        self.assertEqual(state.velocity_W_m_per_s, (0.5, 0.0, -0.25))
        self.send(WORKED["query"])
        query = self.link.next_query()
        self.assertEqual((query.query_id, query.servo_time_ns), (9, 1_502_000_000))
        self.assertEqual(query.position_W_m, (0.125, -0.0625, 0.0625))
        self.assertIsNone(self.link.next_query())

    def test_writes_the_worked_force_sample(self):
        state = self.send(WORKED["tool_state"]).tool_state
        for _ in range(3):  # the worked one has number 3
            self.link.answer(state, (-1.5, 0.0, 2.25), in_contact=True, converged=True, contact_epoch=2,
                             contact_point_W_m=(0.125, -0.0625, 0.0), relative_residual=2**-10,
                             solve_time_s=1 / 64,
                             stiffness_W_N_per_m=(-100, 0, 0, 0, -100, 0, 0, 0, -72))
        sent = [self.servo.recv(512) for _ in range(3)]
        self.assertEqual(sent[2], WORKED["force_sample"])

    def test_reads_the_worked_pose(self):
        state = self.send(WORKED["pose_tool_state"]).tool_state
        self.assertEqual(state.position_W_m, (0.125, -0.0625, 0.03125))
        self.assertEqual((state.has_orientation, state.has_buttons, state.buttons), (True, True, 5))
        self.assertEqual(state.orientation_WT, (0.5, 0.5, -0.5, 0.5))
        self.assertEqual(state.angular_velocity_W_rad_per_s, (0.25, -2.0, 0.0))
        # A servo tries an older version until it is answered: its pose is what it was.
        older = bytearray(WORKED["tool_state"][:-4])
        older[12] = 8
        state = self.send(bytes(older) + struct.pack("<I", zlib.crc32(older))).tool_state
        self.assertEqual((state.sequence, state.orientation_WT, state.buttons), (8, (0.5, 0.5, -0.5, 0.5), 5))

    def test_writes_the_worked_torque(self):
        answer = dict(force_W_N=(-1.5, 0.0, 2.25), in_contact=True, converged=True, contact_epoch=2,
                      contact_point_W_m=(0.125, -0.0625, 0.0), relative_residual=2**-10, solve_time_s=1 / 64,
                      stiffness_W_N_per_m=(-100, 0, 0, 0, -100, 0, 0, 0, -72),
                      torque_W_Nm=(1 / 32, -1 / 16, 0),
                      rotational_stiffness_W_Nm_per_rad=(-0.25, 0, 0.125, 0, -0.25, 0, 0.125, 0, -0.5))
        state = self.send(WORKED["pose_tool_state"]).tool_state
        for _ in range(3):  # the worked one has number 3
            self.link.answer(state, **answer)
        sent = [self.servo.recv(512) for _ in range(3)]
        self.assertEqual(sent[2], WORKED["pose_force_sample"])
        self.link.answer(state, (0, 0, 0), in_contact=False, converged=True)
        without = self.servo.recv(512)
        self.assertEqual(without[44:48], struct.pack("<I", 2))
        self.assertEqual(without[208:336], struct.pack("<16d", *[0] * 3, 1, *[0] * 12))

    def test_sends_no_torque_to_a_servo_without_a_wrist(self):
        state = self.send(WORKED["tool_state"]).tool_state
        self.assertEqual((state.has_orientation, state.orientation_WT), (False, (1.0, 0.0, 0.0, 0.0)))
        for _ in range(3):
            self.link.answer(state, (-1.5, 0.0, 2.25), in_contact=True, converged=True, contact_epoch=2,
                             contact_point_W_m=(0.125, -0.0625, 0.0), relative_residual=2**-10,
                             solve_time_s=1 / 64, torque_W_Nm=(0, 1, 0),
                             stiffness_W_N_per_m=(-100, 0, 0, 0, -100, 0, 0, 0, -72))
        self.assertEqual([self.servo.recv(512) for _ in range(3)][2], WORKED["force_sample"])

    def test_takes_no_unsound_pose_and_sends_no_unsound_torque(self):
        for offset, layout, value in ((80, "d", 0.51), (80, "d", float("nan")), (112, "d", 1001.0),
                                      (140, "I", 4), (140, "I", 1), (140, "I", 2)):
            body = bytearray(WORKED["pose_tool_state"][:-4])
            struct.pack_into("<" + layout, body, offset, value)
            with self.assertRaises(forcegrid_link._Refused):
                forcegrid_link.decode(bytes(body) + struct.pack("<I", zlib.crc32(body)))
        state = self.send(WORKED["pose_tool_state"]).tool_state
        for torque in ({"torque_W_Nm": (0, 1001, 0)}, {"rotational_stiffness_W_Nm_per_rad": [0] * 9},
                       {"torque_W_Nm": (0, 0, 0), "orientation_WT": (1, 1, 0, 0)}):
            with self.assertRaises(ValueError):
                self.link.answer(state, (0, 0, 0), in_contact=True, converged=True, **torque)

    def test_writes_the_worked_surface_patch(self):
        state = self.send(WORKED["tool_state"]).tool_state
        x, y, z = state.position_W_m
        a = 1 / 128
        square = [(x - a, y - a, z - a), (x + a, y - a, z - a), (x + a, y + a, z - a), (x - a, y + a, z - a)]
        for _ in range(4):  # the worked one has number 4
            self.link.show_surface(state, square, [(0, 1, 2), (0, 2, 3)], contact_epoch=2, tool_radius_m=a,
                                   stiffness_W_N_per_m=(-100, -100, -72, 0, 0, 0))
        sent = [self.servo.recv(512) for _ in range(4)]
        self.assertEqual(sent[3], WORKED["surface_patch"])
        self.link.show_surface(state, square, [(0, 1, 2), (0, 2, 3)], contact_epoch=2, tool_radius_m=a,
                               tool_length_m=1 / 32, tool_opening_rad=0.7,
                               press_forces_W_N=((-0.25, 0, 1), (-0.75, 0, 3)))
        self.assertEqual(self.servo.recv(512), WORKED["sliding_patch"])

    def test_shows_no_surface_that_the_servo_would_refuse(self):
        state = self.send(WORKED["tool_state"]).tool_state
        here = state.position_W_m
        for vertices, triangles in (([here] * 20, []), ([here] * 3, [(0, 1, 3)]), ([here] * 3, [(0, 1)]),
                                    ([(float("nan"), 0, 0)] * 3, []), ([(2, 0, 0)] * 3, []),
                                    ([here] * 3, [(0, 1, 2)] * 28)):
            with self.assertRaises(ValueError):
                self.link.show_surface(state, vertices, triangles)
        up = (0, 0, 1)
        for options in ({"press_forces_W_N": (up,)}, {"press_forces_W_N": (up, (0, 0, 1001))},
                        {"press_forces_W_N": (up, up), "stiffness_W_N_per_m": [1] * 6},
                        {"tool_opening_rad": 1.7}):
            with self.assertRaises(ValueError):
                self.link.show_surface(state, [here] * 3, [(0, 1, 2)], **options)

    def test_goodbye_ends_a_session_for_good(self):
        self.assertTrue(self.send(WORKED["tool_state"]).new_session)
        self.assertTrue(self.send(WORKED["goodbye"]).servo_ended)
        self.assertIsNone(self.send(WORKED["tool_state"]).tool_state)
        self.assertEqual(self.link.dropped["foreign session"], 1)

    def test_refuses_every_changed_byte(self):
        for i in range(len(WORKED["tool_state"])):
            changed = bytearray(WORKED["tool_state"])
            changed[i] ^= 0x10
            with self.assertRaises(forcegrid_link._Refused):
                forcegrid_link.decode(bytes(changed))

    def test_takes_no_number_twice(self):
        self.send(WORKED["tool_state"])
        self.assertIsNone(self.send(WORKED["tool_state"]).tool_state)
        self.assertEqual(self.link.dropped["duplicated"], 1)

    def test_sends_nothing_that_the_servo_would_refuse(self):
        state = self.send(WORKED["tool_state"]).tool_state
        for force_W_N in ((float("nan"), 0, 0), (0, 1001, 0)):
            with self.assertRaises(ValueError):
                self.link.answer(state, force_W_N, in_contact=True, converged=True)

    def test_refuses_other_machines_without_a_key(self):
        with self.assertRaisesRegex(forcegrid_link.LinkError, "forcegrid keygen"):
            forcegrid_link.SimulatorLink("0.0.0.0", 0)
        for name in ("127.example.com", "simulator", "127.0.0.1.", ""):
            with self.assertRaisesRegex(forcegrid_link.LinkError, "numeric"):
                forcegrid_link.SimulatorLink(name, 0)
        forcegrid_link.SimulatorLink("localhost", 0).close()


class SealedLink(WithALink):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        file = pathlib.Path(folder.name) / "link.key"
        file.touch(mode=0o600)
        file.write_text("forcegrid-link-key-1 0af94caac92e9cd0 " + bytes(range(32)).hex() + "\n",
                        encoding="ascii")
        self.key_files = (str(file),)
        super().setUp()
        self.link._channel._stream = SIMULATOR_STREAM

    def test_takes_the_worked_sealed_tool_state_once(self):
        self.assertEqual(self.send(WORKED["sealed_tool_state"]).tool_state.sequence, 7)
        self.assertIsNone(self.send(WORKED["sealed_tool_state"]).tool_state)
        self.assertEqual(self.link.dropped["seal: replayed"], 1)

    def test_writes_the_worked_hello(self):
        peer = forcegrid_link._Peer(bytes.fromhex("0af94caac92e9cd0"), SERVO_STREAM, 1_501_000_000,
                                    1_390_500_000)
        with unittest.mock.patch("time.monotonic_ns", return_value=1_391_000_000):
            self.assertEqual(self.link._channel.seal(b"", peer), WORKED["hello"])

    def test_answers_what_is_stale_with_a_hello_that_is_no_longer(self):
        self.link._channel._stream = bytes(16)
        self.assertIsNone(self.send(WORKED["sealed_tool_state"]).tool_state)
        self.assertEqual(self.link.dropped["seal: stale"], 1)
        hello = self.servo.recv(512)
        self.assertLessEqual(len(hello), len(WORKED["sealed_tool_state"]))
        self.assertEqual(hello[40:56], SERVO_STREAM)

    def test_refuses_every_changed_byte(self):
        for i in range(len(WORKED["sealed_tool_state"])):
            changed = bytearray(WORKED["sealed_tool_state"])
            changed[i] ^= 1
            with self.assertRaises(forcegrid_link._Refused):
                self.link._channel.open(bytes(changed))

    def test_refuses_what_is_not_sealed(self):
        self.assertIsNone(self.send(WORKED["tool_state"]).tool_state)
        self.assertEqual(self.link.dropped["seal: not sealed"], 1)


if __name__ == "__main__":
    unittest.main()
