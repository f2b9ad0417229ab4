# SPDX-License-Identifier: Apache-2.0
"""What the tests of forcegrid-view need: the program, a browser's WebSocket, a run's feed and a
simulator's surface stream. Standard library only."""
import base64
import hashlib
import json
import math
import os
import pathlib
import re
import select
import socket
import ssl
import struct
import subprocess
import tempfile
import time

TIMEOUT_S = 10.0
CYCLE = struct.Struct("<Qq Q 3d3d3d 12d 4d 3d 13d II 4B 8B I")
SAMPLE = struct.Struct("<q d 3d3d3d 9d I 4B d")
HELLO = {"version": "0.2.0", "device": "emulated:test", "scene": "block", "rate_Hz": 1000,
         "methods": ["auto", "hold"], "controls": ["stop", "pause", "hand"]}
FEED = {"hello": 1, "cycles": 2, "samples": 3, "arm": 4, "note": 5, "acknowledged": 6, "end": 7,
        "command": 16}


class View:
    """A running forcegrid-view with a page of its own."""

    def __init__(self, program, *arguments, **environment):
        self.page = tempfile.TemporaryDirectory()
        folder = pathlib.Path(self.page.name)
        (folder / "index.html").write_text("<!doctype html><title>page</title>")
        (folder / "app.js").write_text("import './three.module.js';\n")
        (folder / "notes.txt").write_text("not for browsers")
        (folder / "run").mkdir()
        self.log = tempfile.TemporaryFile("w+")
        self.process = subprocess.Popen(
            [program, "--until-stdin-closes", *arguments], stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, stderr=self.log, text=True,
            env={**os.environ, "FORCEGRID_VIEW_PAGE": str(folder),
                 "XDG_RUNTIME_DIR": str(folder / "run"), **environment})
        line = self.process.stdout.readline()
        found = re.fullmatch(r"listening (\S+):(\d+) folder (\S+) token ([0-9a-f]+)"
                             r"(?: certificate ([0-9a-f]{64}))?\n", line)
        if not found:
            raise AssertionError("its first line is %r; it says: %s" % (line, self.said()))
        self.address, port, self.folder, self.token, self.certificate = found.groups()
        self.port = int(port)
        self.host = "%s:%d" % (self.address, self.port)

    def said(self):
        self.log.seek(0)
        return self.log.read()

    def wait_until_it_says(self, words):
        wait_for(lambda: words in self.said(), lambda: "no %r in: %s" % (words, self.said()))

    def resident_bytes(self):
        status = pathlib.Path("/proc/%d/status" % self.process.pid).read_text()
        return 1024 * int(re.search(r"VmRSS:\s*(\d+)", status).group(1))

    def processor_s(self):
        fields = pathlib.Path("/proc/%d/stat" % self.process.pid).read_text().rsplit(")")[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def connect(self):
        """A connection, with TLS if the program has it: its certificate is compared with what it
        says."""
        connection = self.connect_plain()
        if self.certificate is None:
            return connection
        try:
            connection = unchecked_tls().wrap_socket(connection)
            seen = hashlib.sha256(connection.getpeercert(binary_form=True)).hexdigest()
        except BaseException:
            connection.close()
            raise
        if seen != self.certificate:
            raise AssertionError("the certificate is %s, not %s" % (seen, self.certificate))
        return connection

    def connect_plain(self):
        return socket.create_connection((self.address, self.port), timeout=TIMEOUT_S)

    def close(self):
        """Its exit status after its standard input was closed."""
        self.process.stdin.close()
        try:
            return self.process.wait(TIMEOUT_S)
        finally:
            self.process.kill()
            self.process.wait()
            self.process.stdout.close()
            self.log.close()
            self.page.cleanup()


def unchecked_tls():
    """For a browser whose user has compared the fingerprint."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    return context


def make_key_file(file, *arguments, names="DNS:localhost,IP:127.0.0.1", common_name="localhost"):
    """A private key and its certificate in one file, made as the refusal without one says; without
    names it has none but the common one."""
    if names:
        arguments = ("-addext", "subjectAltName=" + names, *arguments)
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1",
         "-nodes", "-days", "365", "-subj", "/CN=" + common_name, *arguments, "-keyout", str(file),
         "-out", str(file)],
        check=True, capture_output=True, timeout=TIMEOUT_S)
    return str(file)


def wait_for(condition, message=lambda: "it does not come"):
    end = time.monotonic() + TIMEOUT_S
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(message())
        time.sleep(0.005)


def http(view, target, method="GET", host=None, extra="", raw=None):
    """Status, headers and body of one request."""
    with view.connect() as connection:
        text = raw
        if raw is None:
            text = "%s %s HTTP/1.1\r\nHost: %s\r\nConnection: close\r\n%s\r\n" % (
                method, target, view.host if host is None else host, extra)
        connection.sendall(text.encode("latin-1"))
        return read_answer(connection)


def read_answer(connection):
    data = b""
    try:
        while piece := connection.recv(65536):
            data += piece
    except ConnectionResetError:
        pass  # what came before counts
    if not data:
        return 0, {}, b""
    head, _, body = data.partition(b"\r\n\r\n")
    lines = head.decode("latin-1").split("\r\n")
    headers = dict(line.lower().split(": ", 1) for line in lines[1:])
    return int(lines[0].split()[1]), headers, body


class Closed(Exception):
    """The other end has closed the connection; the code is that of a WebSocket."""

    def __init__(self, code=None):
        super().__init__(code)
        self.code = code


class Page:
    """A browser's WebSocket."""

    def __init__(self, view, token=None, host=None, origin=True, target=None):
        self.connection = view.connect()
        host = host or view.host
        scheme = "http://" if view.certificate is None else "https://"
        origin = scheme + host if origin is True else origin
        target = target or "/ws?token=" + (view.token if token is None else token)
        key = base64.b64encode(os.urandom(16)).decode()
        self.connection.sendall(
            ("GET %s HTTP/1.1\r\nHost: %s\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
             "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: %s\r\n%s\r\n"
             % (target, host, key, "Origin: %s\r\n" % origin if origin else "")).encode())
        self.data = b""
        while b"\r\n\r\n" not in self.data:
            piece = self.connection.recv(4096)
            if not piece:
                break
            self.data += piece
        head, _, self.data = self.data.partition(b"\r\n\r\n")
        self.status = int(head.split()[1]) if head else 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.connection.close()

    def _take(self, count):
        while len(self.data) < count:
            try:
                piece = self.connection.recv(1 << 20)
            except ConnectionResetError:
                piece = b""
            if not piece:
                raise Closed()
            self.data += piece
        taken, self.data = self.data[:count], self.data[count:]
        return taken

    def receive(self):
        """The next message: a dict for text, bytes otherwise. Pings are answered."""
        while True:
            first, second = self._take(2)
            length = second & 127
            if length == 126:
                length, = struct.unpack(">H", self._take(2))
            elif length == 127:
                length, = struct.unpack(">Q", self._take(8))
            payload = self._take(length)
            opcode = first & 15
            if opcode == 1:
                return json.loads(payload)
            if opcode == 2:
                return payload
            if opcode == 8:
                raise Closed(struct.unpack(">H", payload[:2])[0] if payload else None)
            if opcode == 9:
                self.send(payload, opcode=10)

    def receive_type(self, kind):
        """The next message of this type, a text's name or a binary message's number."""
        end = time.monotonic() + TIMEOUT_S
        while time.monotonic() < end:
            message = self.receive()
            if (message["type"] if isinstance(message, dict) else message[0]) == kind:
                return message
        raise AssertionError("no message of type %r" % (kind,))

    def send(self, payload, opcode=1):
        if isinstance(payload, dict):
            payload = json.dumps(payload)
        if isinstance(payload, str):
            payload = payload.encode()
        mask = os.urandom(4)
        size = bytes([128 | len(payload)]) if len(payload) < 126 else (
            bytes([128 | 126]) + struct.pack(">H", len(payload)))
        masked = bytes(byte ^ mask[i % 4] for i, byte in enumerate(payload))
        self.connection.sendall(bytes([128 | opcode]) + size + mask + masked)

    def closing_code(self):
        """Reads until the server closes."""
        try:
            while True:
                self.receive()
        except Closed as closed:
            return closed.code


def frame_bytes(kind, payload, number=0):
    if isinstance(payload, dict):
        payload = json.dumps(payload)
    if isinstance(payload, str):
        payload = payload.encode()
    return struct.pack("<IHH", len(payload), kind, number) + payload


class Peer:
    """A stream of frames over one of the Unix sockets."""

    def __init__(self, path):
        self.connection = socket.socket(socket.AF_UNIX)
        self.connection.settimeout(TIMEOUT_S)
        self.connection.connect(path)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.connection.close()

    def send(self, kind, payload, number=0):
        self.connection.sendall(frame_bytes(kind, payload, number))

    def receive(self):
        """(type, payload) of the next frame."""
        head = self._take(8)
        size, kind, _ = struct.unpack("<IHH", head)
        return kind, self._take(size)

    def _take(self, count):
        data = b""
        while len(data) < count:
            piece = self.connection.recv(count - len(data))
            if not piece:
                raise Closed()
            data += piece
        return data

    def is_closed(self):
        """Waits for the other end to close."""
        try:
            return bool(select.select([self.connection], [], [], TIMEOUT_S)[0]) and (
                self.connection.recv(1) == b"")
        except ConnectionResetError:
            return True


class Run(Peer):
    """The feed of a run."""

    def __init__(self, view, hello=None):
        super().__init__(view.folder + "/feed")
        self.send(FEED["hello"], hello or HELLO)

    def cycle(self, number, time_ns, **values):
        self.send(FEED["cycles"], cycle_bytes(number, time_ns, **values))

    def command(self):
        kind, payload = self.receive()
        assert kind == FEED["command"], kind
        return json.loads(payload)


def cycle_bytes(number, time_ns, position_W_m=(0, 0, 0), force_W_N=(0, 0, 0), paused=0):
    return CYCLE.pack(number, time_ns, 0, *position_W_m, 0, 0, 0, 0, 0, 0, *(12 * [0.0]),
                      *(4 * [0.5]), *force_W_N, 1000.0, 5.0, 50.0, 300.0, 20.0, 1.0, 0.0, 0.001,
                      1.0, 0.0, 33.0, 0.0, math.inf, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, paused, 0)


def shape_bytes(rest_W_m, triangles, epoch=1):
    return struct.pack("<IIII", epoch, len(rest_W_m), len(triangles), 0) + b"".join(
        struct.pack("<3f", *point) for point in rest_W_m) + b"".join(
        struct.pack("<3I", *corners) for corners in triangles)


def lines_bytes(vertices, springs, element_edges=0, edges=(), epoch=1):
    """What is inside of an object; `edges`: two vertices each."""
    return struct.pack("<5I", epoch, vertices, springs, element_edges, len(edges)) + b"".join(
        struct.pack("<2I", *edge) for edge in edges)


def surface_bytes(steps, epoch=1, time_s=0.0, low=(0, 0, 0), step=(1e-6, 1e-6, 1e-6)):
    """`steps`: three numbers of 0..65535 for each vertex."""
    flat = [number for vertex in steps for number in vertex]
    return struct.pack("<IIId3f3f", epoch, len(steps), 0, time_s, *low, *step) + struct.pack(
        "<%dH" % len(flat), *flat)
