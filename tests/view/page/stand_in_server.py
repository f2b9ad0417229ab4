#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Stands in for forcegrid-view: serves the page and speaks its WebSocket with a synthetic block
that a tool dents, a scope at 500 Hz, samples, an arm. Standard library only; one port.
usage: stand_in_server.py [--port PORT] [--vertices N]      prints the address to open"""
import argparse
import asyncio
import base64
import hashlib
import json
import math
import mimetypes
import pathlib
import struct
import threading
import time
from array import array

ROOT = pathlib.Path(__file__).resolve().parents[3]
PAGE = ROOT / "view" / "page"
JAVASCRIPT = pathlib.Path("/usr/share/javascript")
LIBRARIES = {"/three.module.js": JAVASCRIPT / "three/three.module.js",
             "/dygraph.js": JAVASCRIPT / "dygraphs/dygraph.js",
             "/dygraph.css": JAVASCRIPT / "dygraphs/dygraph.css"}
POLICY = "default-src 'self'; connect-src 'self' ws:"
SIZE_M = 0.1
TOP_M = SIZE_M / 2
RATE_HZ = 500
PHASES = 120  # pictures of one round of the tool, 30 a second
METHODS = ["auto", "forcegrid", "hold"]
AXES = "xyz"
COLUMNS = (["time_s"] + [f"position_{a}_mm" for a in AXES] + [f"force_{a}_N" for a in AXES]
           + ["force_N"] + [f"method{m}_{a}_N" for m in range(4) for a in AXES]
           + [f"method{m}_uncertainty_N" for m in range(4)]
           + ["period_max_us", "wakeup_max_us", "compute_max_us", "report_age_us", "sample_age_ms",
              "energy_mJ", "gain", "damping_gain", "candidate", "reason", "rung", "held_back",
              "limits", "in_contact", "fault", "paused", "rendered_method", "sample_period_ms",
              "requests_per_s", "budget_reads", "arrivals", "missed_deadlines", "cycle"])
SETTINGS = [
    {"name": "budget_us", "label": "Budget of auto", "unit": "µs a cycle", "value": None, "low": 0.5,
     "high": 1000.0, "none": "no limit"},
    {"name": "requests_per_s", "label": "Requests", "unit": "1/s", "value": 120.0, "low": 0.0,
     "high": 500.0},
    {"name": "hand", "label": "Hand", "value": "firm", "choices": ["light", "firm", "arm", "none"]},
    {"name": "simulator_rate_Hz", "label": "Simulator's rate", "unit": "Hz", "value": 30.0,
     "low": 1.0, "high": 200.0, "why_not": "this run did not start the simulator"},
    {"name": "delay_ms", "label": "Link: delay", "unit": "ms", "value": 0.0, "low": 0.0,
     "high": 1000.0},
    {"name": "wall_mm", "label": "Wall above", "unit": "mm", "value": None, "low": 2.0,
     "high": 60.0, "none": "no wall"},
    {"name": "cut", "label": "Cut", "value": "no", "choices": ["no", "yes"]}]
HELLO = {"type": "hello", "version": "0.2.0", "device": "emulated:woodenhaptics_v2015",
         "profile": "woodenhaptics_v2015", "scene": "jelly_block", "rate_Hz": RATE_HZ,
         "simulator_rate_Hz": 30, "methods": METHODS,
         "candidates": ["smooth", "exact", "walls", "memory"],
         "reasons": ["first", "predicted better", "found a wall", "first touches"],
         "rungs": ["fresh", "old", "damping", "zero"],
         "held_back": ["not", "no samples", "motor check", "dead man's switch", "paused"],
         "limits": ["force", "slew", "torque"], "statuses": [], "columns": COLUMNS,
         "workspace_W_m": {"low": [-0.12, -0.12, -0.08], "high": [0.12, 0.12, 0.14]},
         "emulated": True, "controls": ["stop", "pause", "hand", "method", "set"],
         "settings": SETTINGS, "tour": False, "largest_force_N": 5.0, "field": True, "blocks": True,
         "inside": True}


class Block:
    """A cube of SIZE_M with about `vertices` vertices on its surface; a tool dents its top."""

    def __init__(self, vertices):
        self.n = max(2, round(math.sqrt((vertices - 2) / 6)))
        self.rest, self.corners, index = [], [], {}

        def vertex(*ijk):
            if ijk not in index:
                index[ijk] = len(self.rest)
                self.rest.append(tuple((i / self.n - 0.5) * SIZE_M for i in ijk))
            return index[ijk]

        for axis in range(3):
            u, v = (axis + 1) % 3, (axis + 2) % 3
            for side in (0, self.n):
                for a in range(self.n):
                    for b in range(self.n):
                        def at(da, db):
                            ijk = [0, 0, 0]
                            ijk[axis], ijk[u], ijk[v] = side, a + da, b + db
                            return vertex(*ijk)
                        quad = [at(0, 0), at(1, 0), at(1, 1), at(0, 1)]
                        if side == 0:
                            quad.reverse()
                        self.corners += [quad[0], quad[1], quad[2], quad[0], quad[2], quad[3]]
        self.low, self.step = (-0.1, -0.1, -0.1), (0.2 / 65535,) * 3
        self.quantised = array("H", [self.value(x) for point in self.rest for x in point])
        self.kept = {}

    def value(self, x_m):
        return round((x_m - self.low[0]) / self.step[0])

    def shape(self, epoch):
        flat = array("f", [x for point in self.rest for x in point])
        return (struct.pack("<BBHIIII", 2, 0, 0, epoch, len(self.rest), len(self.corners) // 3, 0)
                + flat.tobytes() + array("I", self.corners).tobytes())

    def frame(self, epoch, time_s, values):
        return (struct.pack("<BBHIIId6f", 3, 0, 0, epoch, len(self.rest), 0, time_s, *self.low,
                            *self.step) + values.tobytes())

    def dented(self, phase):
        """Vertices [16-bit] with the tool at a phase of its round."""
        if phase not in self.kept:
            x, y, z = tool_at(phase / PHASES)
            depth, width = max(0.0, TOP_M - z), 0.018
            values = array("H", self.quantised)
            for i, (a, b, c) in enumerate(self.rest):
                r2 = ((a - x) ** 2 + (b - y) ** 2 + (0.5 * (TOP_M - c)) ** 2) / width**2
                if r2 < 9 and c > -TOP_M:
                    values[3 * i + 2] = self.value(c - depth * math.exp(-r2 / 2))
            self.kept[phase] = values
        return self.kept[phase]

    def sheared(self, shift_m):
        """Positions [m] of the block whose top is moved along y and drawn up by the same length."""
        return [(x, y + shift_m * (z / SIZE_M + 0.5), z + shift_m * (z / SIZE_M + 0.5))
                for x, y, z in self.rest]


def tool_at(share):
    """The tool in W [m] after a share of its round, and its depth in the block."""
    angle = 2 * math.pi * share
    return (0.025 * math.cos(angle), 0.03 * math.sin(angle),
            TOP_M - 0.010 + 0.014 * math.cos(angle + 0.6))


def arm_message(tool):
    lines = [[(-0.16, 0, -0.05), (-0.16, 0, 0.10), (-0.09, 0.01, 0.19), tool]]
    body = struct.pack("<I", len(lines))
    for line in lines:
        body += struct.pack("<I", len(line)) + b"".join(struct.pack("<3f", *p) for p in line)
    return struct.pack("<B3x", 5) + body


def blocks_message(boxes, in_use):
    """Blocks of storage, each (method, low corner [m], high corner [m])."""
    return (struct.pack("<BBHI", 7, 0, len(boxes), in_use)
            + b"".join(struct.pack("<I6f", method, *low, *high) for method, low, high in boxes))


# Two of the second method around the middle of the top, and one of the third.
BLOCKS = [(1, (-0.02, -0.02, 0.03), (0.0, 0.0, 0.05)), (1, (0.0, -0.02, 0.03), (0.02, 0.0, 0.05)),
          (2, (-0.02, 0.0, 0.03), (0.0, 0.02, 0.05))]


def lines_message(epoch, vertices, springs, element_edges, edges):
    """What is inside of an object: springs, then edges of tetrahedra, two vertices each."""
    return (struct.pack("<BBHIIIII", 8, 0, 0, epoch, vertices, springs, element_edges, len(edges))
            + b"".join(struct.pack("<2I", *edge) for edge in edges))


def inside_message(epoch, points_m):
    """Where their vertices are, to 1 um, within 65 mm of the lowest."""
    low = [min(point[axis] for point in points_m) for axis in range(3)]
    values = [round((point[axis] - low[axis]) * 1e6) for point in points_m for axis in range(3)]
    return (struct.pack("<BBHIIId6f", 9, 0, 0, epoch, len(points_m), 0, 0.0, *low, *3 * (1e-6,))
            + struct.pack(f"<{len(values)}H", *values))


# Three springs of 30, 40 and 50 mm, and an edge of a tetrahedron of 10 mm.
LINE_POINTS = [(0, -0.02, 0), (0, 0.01, 0), (0, 0.01, -0.04), (0.01, -0.02, 0)]
LINES = [(0, 1), (1, 2), (2, 0), (0, 3)]


class StandIn:
    """The server in a thread. `commands` are the page's messages; `freeze` holds the surface."""

    def __init__(self, vertices=10000, port=0, token="0" * 64, feed_scope=True, pictures_per_s=30):
        self.block, self.port, self.token = Block(vertices), port, token
        self.feed_scope, self.pictures_per_s = feed_scope, pictures_per_s
        self.commands, self.frozen, self.paused, self.stopped = [], None, False, False
        self.hurt = False  # a test says so: its page is not as others expect it
        self.says_paused_by_held_back = False
        self.settings = {one["name"]: dict(one) for one in SETTINGS}
        self.answers_settings, self.tour, self.method = True, False, 0
        self.sends_inside = True
        self.sockets, self.epoch, self.hand, self.refuse_stop = [], 1, None, False
        self.sent_rows = {}  # of the scope, by their time in hundredths of a second
        self.loop = asyncio.new_event_loop()
        self.ready = threading.Event()
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()
        if not self.ready.wait(20):
            raise RuntimeError("the stand-in does not listen")

    @property
    def address(self):
        return f"http://127.0.0.1:{self.port}/?token={self.token}"

    def run(self):
        asyncio.set_event_loop(self.loop)
        try:
            self.loop.run_until_complete(self.serve())
        except asyncio.CancelledError:
            pass
        left = asyncio.all_tasks(self.loop)
        for task in left:
            task.cancel()
        self.loop.run_until_complete(asyncio.gather(*left, return_exceptions=True))
        self.loop.close()

    async def serve(self):
        server = await asyncio.start_server(self.answer, "127.0.0.1", self.port)
        self.port = server.sockets[0].getsockname()[1]
        self.main = asyncio.current_task()
        self.ready.set()
        try:
            await self.feed()
        finally:
            server.close()
            for writer in self.sockets:
                writer.transport.abort()

    def close(self):
        self.loop.call_soon_threadsafe(self.main.cancel)
        self.thread.join(10)

    def say(self, message):
        """Sends a text message to every page, from any thread."""
        self.loop.call_soon_threadsafe(
            lambda: [send_text(writer, message) for writer in self.sockets])

    def freeze(self, positions):
        """Shows these positions [m] from now on; None: moves again."""
        values = positions and array("H", [self.block.value(x) for p in positions for x in p])
        self.frozen = values

    async def answer(self, reader, writer):
        try:
            head = (await reader.readuntil(b"\r\n\r\n")).decode("latin-1")
            path = head.split(" ", 2)[1]
            headers = {line.partition(":")[0].strip().lower(): line.partition(":")[2].strip()
                       for line in head.split("\r\n")[1:]}
            if path.startswith("/ws?"):
                await self.talk(reader, writer, headers, path)
            else:
                self.send_file(writer, path)
                await writer.drain()
        except (asyncio.IncompleteReadError, ConnectionError, BrokenPipeError):
            pass
        finally:
            writer.close()

    def send_file(self, writer, path):
        name, _, query = path.partition("?")
        status, body, kind = "404 Not Found", b"there is no such file", "text/plain"
        file = LIBRARIES.get(name, PAGE / (name.lstrip("/") or "index.html"))
        if name == "/" and query.split("&")[0] != f"token={self.token}":
            status, body = "403 Forbidden", b"the token is missing or wrong"
        elif file.is_file() and (name in LIBRARIES or file.resolve().parent == PAGE):
            status, body = "200 OK", file.read_bytes()
            kind = mimetypes.guess_type(file.name)[0] or "application/octet-stream"
        writer.write((f"HTTP/1.1 {status}\r\nContent-Type: {kind}; charset=utf-8\r\n"
                      f"Content-Length: {len(body)}\r\nContent-Security-Policy: {POLICY}\r\n"
                      "X-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\n"
                      "Cache-Control: no-store\r\nConnection: close\r\n\r\n").encode() + body)

    async def talk(self, reader, writer, headers, path):
        if path != f"/ws?token={self.token}":
            writer.write(b"HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\n\r\n")
            return
        key = headers["sec-websocket-key"] + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"
        accept = base64.b64encode(hashlib.sha1(key.encode()).digest()).decode()
        writer.write(("HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\n"
                      f"Connection: Upgrade\r\nSec-WebSocket-Accept: {accept}\r\n\r\n").encode())
        role = "viewer" if self.sockets else "controller"
        send_text(writer, {**HELLO, "role": role, "tour": self.tour,
                           "settings": list(self.settings.values())})
        send(writer, 2, self.block.shape(self.epoch))
        self.sockets.append(writer)
        try:
            while True:
                opcode, payload = await receive(reader)
                if opcode == 8:
                    return
                if opcode == 1:
                    await self.obey(writer, json.loads(payload))
        finally:
            self.sockets.remove(writer)

    async def obey(self, writer, command):
        self.commands.append({**command, "arrived_s": time.monotonic()})
        what = command["what"]
        answer = {"type": "acknowledged", "id": command.get("id"), "what": what, "done": True}
        if what == "stop" and self.refuse_stop:
            send_text(writer, {**answer, "done": False, "text": "the device is silent"})
        elif what == "stop" and self.stopped:
            send_text(writer, {**answer, "done": False, "text": "the run has ended"})
        elif what == "stop":
            await asyncio.sleep(0.3)
            self.stopped = True
            send_text(writer, {**answer, "text": "zero current is commanded"})
            await asyncio.sleep(0.2)
            send_text(writer, {"type": "end", "ended_by": "stop from the live view",
                               "exit_status": 0, "text": "stopped from the live view"})
        elif what == "pause":
            self.paused = command["value"]
            send_text(writer, {**answer, "text": ""})
        elif what == "hand":
            self.hand = command["target_W_m"]
        elif what == "method":
            self.method = command["method"]
            send_text(writer, {**answer, "text": ""})
        elif what == "set" and command["value"] == 666:
            send_text(writer, {**answer, "done": False, "text": "the simulator refuses it"})
        elif what == "set" and self.answers_settings:
            self.settings[command["name"]]["value"] = command["value"]
            send_text(writer, {"type": "settings", "settings": list(self.settings.values())})
            send_text(writer, {**answer, "text": "done"})
        elif what == "layers":
            if command["blocks"]:
                send(writer, 2, blocks_message(BLOCKS, 5))
            if command["inside"] and self.sends_inside:
                send(writer, 2, lines_message(1, len(LINE_POINTS), 3, 1, LINES))
                send(writer, 2, inside_message(1, LINE_POINTS))
        elif what == "take_control":  # here the newest that asks has it
            send_text(writer, {"type": "role", "role": "controller"})

    async def feed(self):
        began, picture, rows = time.monotonic(), 0, 0
        while True:
            picture += 1
            await asyncio.sleep(max(0.0, began + picture / self.pictures_per_s - time.monotonic()))
            now_s = time.monotonic() - began
            if self.stopped:
                continue
            phase = round(picture * 30 / self.pictures_per_s) % PHASES
            values = self.frozen or self.block.dented(phase)
            self.send_all(self.block.frame(self.epoch, now_s, values))
            if not self.feed_scope:
                continue
            tool = self.hand or tool_at(phase / PHASES)
            self.send_all(arm_message(tool))
            force = max(0.0, TOP_M - tool[2]) * 180
            held = (tool[0], tool[1], TOP_M)
            self.send_all(struct.pack("<BBHI24f", 4, 0, 2, 0, *tool, 0, 0, force, now_s, force > 0,
                                      *held, 7, *tool, 0, 0, force, now_s, 2 + (force > 0),
                                      *held, 7))
            due = int(now_s * 100)
            self.send_all(self.scope(rows, min(due, rows + 1000)))
            rows = due

    def scope(self, first, end):
        new = {i: self.row(i / 100) for i in range(first, end)}
        self.sent_rows.update(new)
        base_s = first / 100  # 32 bits hold the time since then to the microsecond
        rows = b"".join(struct.pack(f"<{len(COLUMNS)}f", row[0] - base_s, *row[1:])
                        for row in new.values())
        return struct.pack("<BBHId", 1, 0, end - first, len(COLUMNS), base_s) + rows

    def row(self, time_s):
        share = time_s * 30 / PHASES % 1
        tool = self.hand or tool_at(share)
        depth = max(0.0, TOP_M - tool[2])
        ripple = 0.12 * math.sin(40 * time_s) if depth else 0
        gain = 0.0 if self.paused else 1.0
        true = (0.9 * depth * 60 * math.cos(6.28 * share), 0.5 * depth * 60, depth * 180)
        auto, grid = true, [1.12 * f for f in true]
        hold = [f + ripple for f in true] if depth else [0.0] * 3
        command = [gain * f for f in auto]
        candidate = int(time_s / 1.7) % 4
        held_back = 4 * (self.paused and self.says_paused_by_held_back)
        paused = float(self.paused and not held_back)
        return [time_s, *(1000 * x for x in tool), *command, math.hypot(*command), *auto, *grid,
                *hold, *[math.nan] * 3, 0.02, 0.1, math.nan, math.nan,
                2000 + 60 * abs(math.sin(7 * time_s)) + 900 * (int(time_s * 100) % 310 == 0),
                8 + 5 * abs(math.sin(11 * time_s)), 130 + 40 * abs(math.sin(3 * time_s)), 420.0,
                35 + 30 * (time_s * 30 % 1), 4 * math.sin(6.28 * share), gain, 0.0, candidate,
                candidate, 0, held_back, 0, float(depth > 0), 0, paused, self.method, 33.3,
                self.settings["requests_per_s"]["value"], math.inf, int(time_s * 60), 3,
                int(time_s * RATE_HZ)]

    def send_all(self, message):
        for writer in self.sockets:
            # A page that is slow, or gone, loses messages.
            if not writer.is_closing() and writer.transport.get_write_buffer_size() < 1 << 20:
                send(writer, 2, message)


def send(writer, opcode, payload):
    size = len(payload)
    head = (struct.pack(">BB", 0x80 | opcode, size) if size < 126
            else struct.pack(">BBH", 0x80 | opcode, 126, size) if size < 65536
            else struct.pack(">BBQ", 0x80 | opcode, 127, size))
    writer.write(head + payload)


def send_text(writer, message):
    send(writer, 1, json.dumps(message).encode())


async def receive(reader):
    """(opcode, payload) of one masked frame of a browser."""
    first, size = await reader.readexactly(2)
    size &= 0x7F
    if size >= 126:
        size = int.from_bytes(await reader.readexactly(2 if size == 126 else 8), "big")
    mask = await reader.readexactly(4)
    payload = await reader.readexactly(size)
    return first & 0x0F, bytes(byte ^ mask[i % 4] for i, byte in enumerate(payload))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--port", type=int, default=0)
    parser.add_argument("--vertices", type=int, default=10000)
    options = parser.parse_args()
    stand_in = StandIn(options.vertices, options.port)
    print(stand_in.address, flush=True)
    stand_in.thread.join()


if __name__ == "__main__":
    main()
