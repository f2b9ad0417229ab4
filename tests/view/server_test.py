#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""forcegrid-view as browsers, a run and simulators meet it, hostile ones among them.
usage: server_test.py FORCEGRID_VIEW [TEST...]"""
import json
import os
import pathlib
import random
import re
import select
import shutil
import signal
import socket
import stat
import struct
import subprocess
import sys
import tempfile
import unittest

import peers
from peers import (FEED, HELLO, Page, Peer, Run, View, cycle_bytes, http, lines_bytes, shape_bytes,
                   surface_bytes)
from with_view import PROGRAM, SEED, WithView, rows_of

TRIANGLE = ((0, 0, 0), (0.1, 0, 0), (0, 0.1, 0))


class Http(WithView):
    def test_gives_the_page_to_the_token_and_its_code_to_all(self):
        view = self.view
        status, headers, body = http(view, "/?token=" + view.token)
        self.assertEqual((status, headers["content-type"]), (200, "text/html; charset=utf-8"))
        self.assertIn(b"<title>page</title>", body)
        self.assertIn("default-src 'self'", headers["content-security-policy"])
        self.assertEqual(headers["cache-control"], "no-store")
        self.assertEqual(http(view, "/")[0], 403)
        self.assertEqual(http(view, "/?token=" + "0" * 64)[0], 403)
        for path in ("/app.js", "/three.module.js", "/OrbitControls.js", "/build/three.module.js",
                     "/dygraph.js", "/dygraph.css"):
            status, headers, body = http(view, path)
            self.assertEqual(status, 200, path)
            self.assertEqual(int(headers["content-length"]), len(body))
            self.assertRegex(headers["content-type"], "text/(javascript|css)")
        for path in ("/notes.txt", "/run", "/../etc/passwd", "/..%2f..%2fetc/passwd", "/ws"):
            self.assertEqual(http(view, path)[0], 404, path)

    def test_refuses_another_host_name_that_resolves_to_this_machine(self):
        for host in ("evil.example", "evil.example:%d" % self.view.port, "127.0.0.1", "127.0.0.1:1",
                     ""):
            status, _, body = http(self.view, "/?token=" + self.view.token, host=host)
            self.assertEqual(status, 403, host)
            self.assertNotIn(b"<title>", body)
            with Page(self.view, host=host or "none", origin=None) as page:
                self.assertEqual(page.status, 403, host)
        for host in ("localhost", "[::1]"):
            host = "%s:%d" % (host, self.view.port)
            self.assertEqual(http(self.view, "/app.js", host=host)[0], 200, host)
        twice = "GET /app.js HTTP/1.1\r\nHost: %s\r\nHost: evil.example\r\n\r\n" % self.view.host
        self.assertIn(http(self.view, "", raw=twice)[0], (400, 403))

    def test_takes_get_and_head_alone(self):
        status, headers, body = http(self.view, "/app.js", method="HEAD")
        self.assertEqual((status, body), (200, b""))
        self.assertGreater(int(headers["content-length"]), 0)
        for method in ("POST", "PUT", "DELETE", "OPTIONS", "TRACE"):
            self.assertEqual(http(self.view, "/app.js", method=method)[0], 405, method)
        self.assertEqual(http(self.view, "/app.js", extra="Content-Length: 5\r\n\r\nhello")[0], 413)

    def test_serves_several_requests_on_one_connection(self):
        request = "GET /app.js HTTP/1.1\r\nHost: %s\r\n\r\n" % self.view.host
        last = request.replace("\r\n\r\n", "\r\nConnection: close\r\n\r\n")
        with self.view.connect() as connection:
            connection.sendall((request + request + last).encode())
            data = b""
            while piece := connection.recv(65536):
                data += piece
        self.assertEqual(data.count(b"HTTP/1.1 200 OK"), 3)

    def test_refuses_large_headers_and_what_is_no_http(self):
        large = "X-Large: %s\r\n" % ("x" * 9000)
        self.assertIn(http(self.view, "/app.js", extra=large)[0], (431, 0))
        for raw in ("hello\r\n\r\n", "GET / HTTP/9.9\r\n\r\n", "GET /\x00 HTTP/1.1\r\n\r\n",
                    "\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n"):
            self.assertEqual(http(self.view, "", raw=raw)[0], 400, repr(raw))
        generator = random.Random(SEED)
        for _ in range(50):
            with self.view.connect() as connection:
                try:
                    connection.sendall(generator.randbytes(generator.randrange(1, 4000)))
                    connection.shutdown(socket.SHUT_WR)
                    while connection.recv(65536):
                        pass
                except OSError:
                    pass  # it may close before all is sent

    def test_survives_200_connections_and_says_that_it_is_full(self):
        page, run = self.live_page()
        connections = [self.view.connect() for _ in range(200)]
        waiting, refused = set(connections), 200 - 31  # 31 may ask, beside the page
        while len(waiting) > 200 - refused:
            spoken, _, _ = select.select(waiting, [], [], peers.TIMEOUT_S)
            self.assertTrue(spoken, "%d connections are left, not 31" % len(waiting))
            for connection in spoken:
                try:
                    self.assertIn(connection.recv(4096)[:12], (b"HTTP/1.1 503", b""))
                except ConnectionResetError:
                    pass
            waiting -= set(spoken)
        request = "GET /app.js HTTP/1.1\r\nHost: %s\r\nConnection: close\r\n\r\n" % self.view.host
        for connection in waiting:
            connection.sendall(request.encode())
            self.assertEqual(peers.read_answer(connection)[0], 200)
        page.send({"id": 1, "what": "stop"})
        self.assertEqual(run.command()["what"], "stop", "the page's own connection goes on")
        for connection in connections:
            connection.close()
        peers.wait_for(lambda: http(self.view, "/app.js")[0] == 200)


class WebSockets(WithView):
    def test_open_for_this_servers_page_and_for_scripts_with_the_token(self):
        for origin, token, status in ((True, None, 101), (None, None, 101),
                                      ("http://evil.example", None, 403), ("null", None, 403),
                                      ("https://" + self.view.host, None, 403), (True, "", 403),
                                      (True, "0" * 64, 403)):
            with Page(self.view, token=token, origin=origin) as page:
                self.assertEqual(page.status, status, (origin, token))
        with Page(self.view, target="/?token=" + self.view.token) as page:
            self.assertEqual(page.status, 404)

    def test_show_a_run_from_its_begin_to_its_end(self):
        with Page(self.view) as page:
            self.assertEqual(page.receive()["type"], "waiting")
            self.assertEqual(page.receive()["role"], "controller")
            with Run(self.view) as run:
                hello = page.receive()
                self.assertEqual({**hello, **HELLO, "type": "hello"}, hello)
                for cycle in range(25):
                    run.cycle(1000 + cycle, 10**12 + cycle * 1_000_000,
                              position_W_m=(0.001 * cycle, 0, 0), force_W_N=(3, 0, 4), paused=1)
                rows = []
                while len(rows) < 2:
                    rows += rows_of(page.receive_type(1), hello["columns"])
                # Cycles 0..9 and 10..19 of 1 ms are the first two buckets.
                self.assertEqual([row["cycle"] for row in rows], [1009, 1019])
                self.assertAlmostEqual(rows[1]["time_s"], 0.019, places=6)
                self.assertAlmostEqual(rows[1]["position_x_mm"], 19, places=4)
                self.assertAlmostEqual(rows[1]["force_N"], 5, places=5)
                self.assertEqual(rows[1]["paused"], 1)
                self.assertEqual(rows[1]["sample_age_ms"], 20)
                run.send(FEED["note"], {"level": "warn", "component": "servo", "text": "late"})
                self.assertEqual(page.receive_type("note")["text"], "late")
                run.send(FEED["end"], {"ended_by": "stop", "exit_status": 0, "text": "stopped"})
                self.assertEqual(page.receive_type("end")["ended_by"], "stop")

    def test_show_samples_and_the_arm(self):
        page, run = self.live_page()
        run.cycle(0, 10**12)
        run.send(FEED["samples"], peers.SAMPLE.pack(
            10**12 + 250_000_000, 0.0, 1, 2, 3, -1, -2, -3, *(12 * [0.0]), 1, 1, 0, 0, 1, 0.0))
        message = page.receive_type(4)
        self.assertEqual(struct.unpack_from("<BxHI", message), (4, 1, 0))
        self.assertEqual(struct.unpack("<12f", message[8:]),
                         (1, 2, 3, -1, -2, -3, 0.25, 1, 0, 0, 0, 1))
        arm = struct.pack("<II6f", 1, 2, 0, 0, 0, 1, 1, 1)
        run.send(FEED["arm"], arm)
        self.assertEqual(page.receive_type(5), b"\x05\0\0\0" + arm)

    def test_pass_commands_on_and_acknowledgements_back(self):
        page, run = self.live_page()
        with Page(self.view) as other:
            self.assertEqual(other.receive_type("hello")["role"], "viewer")
            for sender, command in ((page, {"id": 5, "what": "pause", "value": True}),
                                    (page, {"id": 6, "what": "hand", "target_W_m": [0.01, 0, 0]}),
                                    (page, {"id": 7, "what": "hand", "target_W_m": None}),
                                    (other, {"id": 5, "what": "stop"})):
                sender.send(command)
                got = run.command()
                self.assertEqual({**got, "id": command["id"]}, command)
            run.send(FEED["acknowledged"],
                     {"id": got["id"], "what": "stop", "done": True, "text": "off"})
            self.assertEqual(other.receive_type("acknowledged"),
                             {"type": "acknowledged", "id": 5, "what": "stop", "done": True,
                              "text": "off"})
            other.send({"id": 8, "what": "pause", "value": False})
            self.assertFalse(other.receive_type("acknowledged")["done"], "it is not the controller")
        page.connection.close()
        with Page(self.view) as reloaded:
            self.assertEqual(reloaded.receive_type("hello")["role"], "controller")

    def test_disconnect_a_page_that_sends_anything_else(self):
        page, run = self.live_page()
        for payload, opcode, code in (("no JSON", 1, 1008), ({"what": "format"}, 1, 1008),
                                      ({"id": 1, "what": "stop", "x": "y" * 4100}, 1, 1009),
                                      (b"binary", 2, 1008), (b"\xff\xfe", 1, 1007),
                                      ("[" * 4000, 1, 1008), (b"", 3, 1002)):
            with Page(self.view) as bad:
                bad.receive_type("hello")
                bad.send(payload, opcode=opcode)
                self.assertEqual(bad.closing_code(), code, (payload, opcode))
        generator = random.Random(SEED)
        for _ in range(50):
            with Page(self.view) as bad:
                try:
                    bad.connection.sendall(generator.randbytes(generator.randrange(1, 3000)))
                    bad.connection.shutdown(socket.SHUT_WR)
                    bad.closing_code()
                except OSError:
                    pass  # it may close before all is sent
        # A frame that announces more than it has, and then nothing.
        with Page(self.view) as bad:
            bad.connection.sendall(bytes([0x81, 0xff]) + struct.pack(">Q", 1 << 62) + b"1234")
            self.assertEqual(bad.closing_code(), 1009)
        page.send({"id": 1, "what": "stop"})
        self.assertEqual(run.command()["what"], "stop", "the others are not disturbed")

    def test_hold_up_nobody_and_take_no_memory_for_a_page_that_does_not_read(self):
        page, run = self.live_page()
        with Page(self.view) as deaf, Peer(self.view.folder + "/surface") as simulator:
            deaf.receive_type("hello")
            simulator.send(2, shape_bytes([(0, 0, 0)] * 20_000, [(0, 1, 2)]))
            page.receive_type(2)
            before = self.view.resident_bytes()
            sent, time_ns = 0, 10**12
            for number in range(400):
                surface = surface_bytes([(1, 2, 3)] * 20_000) if number == 0 else surface
                simulator.send(3, surface)
                # 160 cycles of 11 ms each: every one ends a bucket.
                cycles = b"".join(cycle_bytes(number, time_ns + i * 11_000_000) for i in range(160))
                time_ns += 160 * 11_000_000
                run.send(FEED["cycles"], cycles)
                sent += len(surface) + len(cycles)
            run.send(FEED["note"], {"level": "info", "text": "all of it"})
            while page.receive_type("note")["text"] != "all of it":
                pass
            grown = self.view.resident_bytes() - before
            self.assertGreater(sent, 60e6)
            if not os.environ.get("FORCEGRID_SANITIZED"):  # they keep what is freed
                self.assertLess(grown, 16e6, "bytes, for a page that does not read")
            print("resident memory grows by %.1f MB while %.0f MB are sent to a page that does not "
                  "read" % (grown / 1e6, sent / 1e6))
            # Texts are not left out: too many that are not read end the connection.
            for _ in range(40):
                run.send(FEED["note"], {"level": "info", "text": "x" * 60_000})
            self.view.wait_until_it_says("disconnected a page that does not read")


class Feeds(WithView):
    def test_come_back_after_they_broke_off(self):
        page, run = self.live_page()
        run.connection.close()
        page.receive_type("waiting")
        with Run(self.view, {**HELLO, "scene": "small"}) as again:
            self.assertEqual(page.receive_type("hello")["scene"], "small")
            page.send({"id": 2, "what": "stop"})
            self.assertEqual(again.command()["what"], "stop")

    def test_are_one_at_a_time_for_each_tool(self):
        page, run = self.live_page()
        with Peer(self.view.folder + "/feed") as second:
            second.send(FEED["hello"], HELLO)
            self.assertTrue(second.is_closed())
        self.view.wait_until_it_says("a hello of tool 0, which another run shows")
        page.send({"id": 2, "what": "stop"})
        self.assertEqual(run.command()["what"], "stop")

    def test_of_two_tools_get_the_commands_of_the_pages_that_chose_them(self):
        page, first = self.live_page()
        second = Peer(self.view.folder + "/feed")
        self.addCleanup(second.connection.close)
        second.connection.sendall(peers.frame_bytes(FEED["hello"], {**HELLO, "device": "two"}, 1))
        self.assertEqual([tool["device"] for tool in page.receive_type("tools")["tools"]],
                         [HELLO["device"], "two"])
        page.send({"what": "tool", "tool": 1})
        self.assertEqual(page.receive_type("hello")["device"], "two")
        page.send({"id": 3, "what": "stop"})
        kind, payload = second.receive()
        self.assertEqual((kind, json.loads(payload)["what"]), (FEED["command"], "stop"))
        second.connection.close()
        self.assertFalse(page.receive_type("tools")["tools"][1]["live"])
        page.send({"what": "tool", "tool": 0})
        self.assertEqual(page.receive_type("hello")["device"], HELLO["device"])
        page.send({"id": 4, "what": "stop"})
        self.assertEqual(first.command()["what"], "stop")

    def test_end_with_a_reason_if_they_break_the_protocol(self):
        for bad, words in ((peers.frame_bytes(2, cycle_bytes(1, 1)), "before the hello"),
                           (peers.frame_bytes(1, "{"), "no JSON object"),
                           (peers.frame_bytes(1, '{"a":' * 20_000), "no JSON object"),
                           (struct.pack("<IHH", 65537, 1, 0), "65537 bytes"),
                           (struct.pack("<IHH", 2**32 - 1, 1, 0), "4294967295 bytes"),
                           (peers.frame_bytes(1, HELLO) + peers.frame_bytes(10, b""), "type 10")):
            with Peer(self.view.folder + "/feed") as peer:
                peer.connection.sendall(bad)
                self.assertTrue(peer.is_closed())
            self.view.wait_until_it_says(words)
        generator = random.Random(SEED)
        for _ in range(50):
            with Peer(self.view.folder + "/feed") as peer:
                try:
                    peer.connection.sendall(generator.randbytes(3000))
                    peer.is_closed()
                except OSError:
                    pass  # it may close before all is sent

    def test_get_their_last_words_to_the_page(self):
        page, run = self.live_page()
        self.view.process.stdin.close()  # the parent ends, with a feed that is still there
        run.send(FEED["end"], {"ended_by": "time"})
        run.connection.close()
        self.assertEqual(page.receive_type("end")["ended_by"], "time")
        self.assertEqual(page.closing_code(), 1001)
        self.assertEqual(self.view.process.wait(peers.TIMEOUT_S), 0)
        self.view.close()
        self.view = View(PROGRAM)  # which the end of each test looks for


class Surfaces(WithView):
    def test_go_to_each_page_as_they_come(self):
        with Peer(self.view.folder + "/surface") as simulator, Page(self.view) as page:
            shape, frame = shape_bytes(TRIANGLE, [(0, 1, 2)]), surface_bytes([(1, 2, 3)] * 3)
            simulator.send(2, shape, number=1)
            simulator.send(3, frame, number=1)
            self.assertEqual(page.receive_type(2), b"\x02\x01\0\0" + shape)
            self.assertEqual(page.receive_type(3), b"\x03\x01\0\0" + frame)
            with Page(self.view) as later:
                self.assertEqual(later.receive_type(2), b"\x02\x01\0\0" + shape)
                self.assertEqual(later.receive_type(3), b"\x03\x01\0\0" + frame)
            simulator.connection.close()
            self.assertEqual(page.receive_type("surface_lost")["object"], 1)

    def test_come_from_four_simulators_at_most(self):
        simulators = [Peer(self.view.folder + "/surface") for _ in range(4)]
        for number, simulator in enumerate(simulators):
            simulator.send(2, shape_bytes(TRIANGLE, [(0, 1, 2)]), number)
        with Page(self.view) as page:
            self.assertEqual(sorted(page.receive_type(2)[1] for _ in range(4)), [0, 1, 2, 3])
        with Peer(self.view.folder + "/surface") as fifth:
            self.assertTrue(fifth.is_closed())
        for simulator in simulators:
            simulator.connection.close()

    def test_end_with_a_reason_if_they_break_the_protocol(self):
        shape = peers.frame_bytes(2, shape_bytes(TRIANGLE, [(0, 1, 2)]))
        for bad, words in ((peers.frame_bytes(3, surface_bytes([(0, 0, 0)])), "before its shape"),
                           (peers.frame_bytes(2, shape_bytes(TRIANGLE, [(0, 1, 3)])), "its shape"),
                           (peers.frame_bytes(2, shape_bytes(TRIANGLE, [])[:-1]), "its shape of"),
                           (shape + peers.frame_bytes(3, surface_bytes([(0, 0, 0)])), "1 vertices"),
                           (peers.frame_bytes(2, shape_bytes(TRIANGLE, []), 4), "object 4"),
                           (peers.frame_bytes(7, b""), "unknown type 7"),
                           (peers.frame_bytes(4, lines_bytes(2, 0)), "before its shape"),
                           (shape + peers.frame_bytes(4, lines_bytes(2, 1, edges=[(0, 2)])),
                            "an edge without a vertex"),
                           (shape + peers.frame_bytes(4, lines_bytes(2, 1)), "its inside of"),
                           (shape + peers.frame_bytes(4, lines_bytes(2, 300_001, edges=[(0, 1)] * 2)),
                            "its inside of"),
                           (shape + peers.frame_bytes(4, lines_bytes(2, 1, edges=[(0, 1)]))
                            + peers.frame_bytes(5, surface_bytes([(0, 0, 0)])), "its inside has 1"),
                           (struct.pack("<IHH", (64 << 20) + 1, 2, 0), "67108865 bytes")):
            with Peer(self.view.folder + "/surface") as peer:
                peer.connection.sendall(bad)
                self.assertTrue(peer.is_closed())
            self.view.wait_until_it_says(words)


class Insides(WithView):
    """What is inside of an object: its simulator sends it while a page shows it."""
    SHOW = {"what": "layers", "blocks": False, "inside": True}
    HIDE = {"what": "layers", "blocks": False, "inside": False}
    WISH, NO_WISH = (16, struct.pack("<I", 1)), (16, struct.pack("<I", 0))

    def page(self):
        page = Page(self.view)
        self.addCleanup(page.connection.close)
        page.receive_type("role")
        return page

    def test_are_asked_of_simulators_while_any_page_shows_them(self):
        with Peer(self.view.folder + "/surface") as first, Peer(
                self.view.folder + "/surface") as second:
            first.send(2, shape_bytes(TRIANGLE, [(0, 1, 2)]), 0)
            second.send(2, shape_bytes(TRIANGLE, [(0, 1, 2)]), 1)
            page, other = self.page(), self.page()
            page.receive_type(2)
            page.receive_type(2)
            page.send(self.SHOW)
            self.assertEqual([first.receive(), second.receive()], [self.WISH, self.WISH])
            other.send(self.SHOW)
            lines = lines_bytes(3, 1, 1, edges=[(0, 1), (1, 2)])
            frame = surface_bytes([(1, 2, 3)] * 3)
            first.send(4, lines, 0)
            first.send(5, frame, 0)
            for each in (page, other):
                self.assertEqual(each.receive_type(8), b"\x08\0\0\0" + lines)
                self.assertEqual(each.receive_type(9), b"\x09\0\0\0" + frame)
            with Peer(self.view.folder + "/surface") as third:
                third.send(2, shape_bytes(TRIANGLE, [(0, 1, 2)]), 2)
                self.assertEqual(third.receive(), self.WISH, "it came later")
                page.send(self.HIDE)
                other.connection.close()
                self.assertEqual([each.receive() for each in (first, second, third)],
                                 [self.NO_WISH] * 3)
            first.send(5, frame, 0)
            first.send(3, surface_bytes([(7, 7, 7)] * 3), 0)
            kinds = []  # of what comes, until the surface that was sent last
            while 3 not in kinds:
                message = page.receive()
                kinds.append(message[0] if isinstance(message, bytes) else message["type"])
            self.assertNotIn(9, kinds, "it does not show it any more")

    def test_leave_simulators_alone_that_read_nothing(self):
        with Peer(self.view.folder + "/surface") as old:
            old.send(2, shape_bytes(TRIANGLE, [(0, 1, 2)]))
            page = self.page()
            page.receive_type(2)
            for _ in range(20_000):  # 12 bytes each are more than its socket and the view keep
                page.send(self.SHOW)
                page.send(self.HIDE)
            page.send(self.SHOW)
            old.send(3, surface_bytes([(1, 2, 3)] * 3))
            self.assertEqual(len(page.receive_type(3)), 4 + 44 + 18)
        self.assertEqual(page.receive_type("surface_lost")["object"], 0)
        self.assertNotIn("simulator", self.view.said(), "it closed its connection, that is all")

    def test_are_not_asked_by_pages_that_do_not_know_them(self):
        with Peer(self.view.folder + "/surface") as simulator:
            simulator.send(2, shape_bytes(TRIANGLE, [(0, 1, 2)]))
            old, page = self.page(), self.page()
            page.receive_type(2)
            old.send({"what": "layers", "blocks": False})
            old.send({"what": "take_control"})
            old.receive_type("role")  # both have been read
            page.send(self.SHOW)
            page.send(self.HIDE)
            self.assertEqual([simulator.receive(), simulator.receive()], [self.WISH, self.NO_WISH])


class Examples(WithView):
    """Programs of docs/view_protocol.md, as they stand there."""

    def program(self, language):
        page = pathlib.Path(__file__).parents[2] / "docs/view_protocol.md"
        blocks = re.findall("^```%s\n(.*?)^```" % language, page.read_text(encoding="utf-8"),
                            re.MULTILINE | re.DOTALL)
        self.assertEqual(len(blocks), 1, language)
        return blocks[0]

    def check(self, command, vertices, triangles):
        with Page(self.view) as page:
            process = subprocess.Popen([*command, self.view.folder + "/surface"])
            try:
                shape = page.receive_type(2)
                self.assertEqual(struct.unpack_from("<II", shape, 8), (vertices, triangles))
                times_s = []
                while len(times_s) < 3:
                    frame = page.receive_type(3)
                    self.assertEqual(struct.unpack_from("<I", frame, 8)[0], vertices)
                    times_s.append(struct.unpack_from("<d", frame, 16)[0])
                self.assertEqual(times_s, sorted(set(times_s)))
                # A page that wishes to see the inside, which this program knows nothing of.
                page.send({"what": "layers", "blocks": False, "inside": True})
                for _ in range(3):
                    page.receive_type(3)
            finally:
                process.kill()
                process.wait()
            self.assertEqual(page.receive_type("surface_lost")["object"], 0)
            self.assertNotIn("disconnected", self.view.said())

    def test_in_python_show_a_sheet(self):
        self.check([sys.executable, "-c", self.program("python")], 900, 1682)

    def test_in_c_show_a_triangle(self):
        with tempfile.TemporaryDirectory() as folder:
            source, program = pathlib.Path(folder) / "simulator.c", folder + "/simulator"
            source.write_text(self.program("c"))
            subprocess.run(["gcc", "-Wall", "-Wextra", "-Werror", "-o", program, source, "-lm"],
                           check=True)
            self.check([program], 3, 1)


class Program(unittest.TestCase):
    def setUp(self):
        self.page = tempfile.TemporaryDirectory()
        self.addCleanup(self.page.cleanup)
        (pathlib.Path(self.page.name) / "index.html").write_text("<!doctype html>")

    def run_program(self, *arguments, **environment):
        return subprocess.run([PROGRAM, *arguments], capture_output=True, text=True,
                              stdin=subprocess.DEVNULL, timeout=peers.TIMEOUT_S,
                              env={**os.environ, "FORCEGRID_VIEW_PAGE": self.page.name,
                                   **environment})

    def test_says_what_it_is(self):
        self.assertIn("--until-stdin-closes", self.run_program("--help").stdout)
        self.assertRegex(self.run_program("--version").stdout, r"^forcegrid-view \d+\.\d+\.\d+\n$")

    def test_refuses_wrong_use_in_a_sentence(self):
        for arguments, words in ((["--listen", "0.0.0.0:0"], "other machines reach"),
                                 (["--listen", "127.0.0.1"], "no port"), (["--x"], "--help")):
            done = self.run_program(*arguments)
            self.assertEqual((done.returncode, done.stdout), (2, ""))
            self.assertIn(words, done.stderr)
        done = self.run_program(FORCEGRID_VIEW_TOKEN="1234")
        self.assertEqual(done.returncode, 2)
        self.assertIn("FORCEGRID_VIEW_TOKEN", done.stderr)
        self.assertNotIn("1234 ", done.stderr)
        done = self.run_program(FORCEGRID_VIEW_PAGE="/nowhere")
        self.assertEqual(done.returncode, 2)
        self.assertIn("/nowhere/index.html", done.stderr)

    def test_has_a_manual_page_with_all_it_takes(self):
        page = (pathlib.Path(__file__).parents[2] / "view/forcegrid-view.1").read_text()
        page = page.replace("\\-", "-")
        said = self.run_program("--help").stdout
        words = set(re.findall(r"--[a-z-]+|FORCEGRID_[A-Z_]+", said))
        self.assertGreater(len(words), 4)
        for word in words:
            self.assertIn(word, page)

    def test_finds_its_page_where_it_is_installed(self):
        with tempfile.TemporaryDirectory() as prefix:
            folder = pathlib.Path(prefix)
            (folder / "bin").mkdir()
            program = shutil.copy(PROGRAM, folder / "bin")
            page = folder / "share/forcegrid/view"
            page.mkdir(parents=True)
            (page / "index.html").write_text("<title>installed</title>")
            environment = {name: value for name, value in os.environ.items()
                           if name != "FORCEGRID_VIEW_PAGE"}
            with subprocess.Popen([program, "--until-stdin-closes"], stdin=subprocess.PIPE,
                                  stdout=subprocess.PIPE, text=True, env=environment) as process:
                words = process.stdout.readline().split()
                address, token = words[1], words[5]
                host, port = address.split(":")
                with socket.create_connection((host, int(port)), timeout=peers.TIMEOUT_S) as browser:
                    browser.sendall(("GET /?token=%s HTTP/1.1\r\nHost: %s\r\nConnection: close"
                                     "\r\n\r\n" % (token, address)).encode())
                    self.assertIn(b"installed", peers.read_answer(browser)[2])
                process.stdin.close()
                self.assertEqual(process.wait(peers.TIMEOUT_S), 0)

    def test_refuses_a_port_that_is_taken(self):
        with socket.create_server(("127.0.0.1", 0)) as taken:
            done = self.run_program("--listen", "127.0.0.1:%d" % taken.getsockname()[1])
        self.assertEqual(done.returncode, 2)
        self.assertIn("in use", done.stderr)

    def test_keeps_its_folder_and_sockets_to_this_account(self):
        view = View(PROGRAM, FORCEGRID_VIEW_TOKEN="ab" * 20)
        self.assertEqual(view.token, "ab" * 20)
        folder = pathlib.Path(view.folder)
        self.assertEqual(stat.S_IMODE(folder.stat().st_mode), 0o700)
        self.assertEqual(sorted(entry.name for entry in folder.iterdir()), ["feed", "surface"])
        self.assertNotIn(view.token, pathlib.Path(
            "/proc/%d/cmdline" % view.process.pid).read_text())
        self.assertEqual(view.close(), 0)

    def test_obeys_a_signal_but_leaves_an_interrupt_to_its_parent(self):
        view = View(PROGRAM)
        folder = pathlib.Path(view.folder)
        view.process.send_signal(signal.SIGINT)
        self.assertEqual(http(view, "/app.js")[0], 200)
        view.process.send_signal(signal.SIGTERM)
        self.assertEqual(view.process.wait(peers.TIMEOUT_S), 0)
        self.assertFalse(folder.exists())
        view.close()


if __name__ == "__main__":
    unittest.main()
