#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The simulator's end of Forcegrid's link, in one file to copy to a machine without the package.

Where the package is installed, `from forcegrid import SimulatorLink` is the same, compiled.
docs/simulators.md explains how to use it, docs/link_protocol.md has every byte. It needs only Python
3.9's standard library, and PyNaCl (Debian: python3-nacl) for a link with a key. A spring that is at
rest where it catches the tool:

    from forcegrid_link import SimulatorLink

    link = SimulatorLink("127.0.0.1", 24870)  # key_files=["link.key"] for another machine
    anchor = None
    while True:
        news = link.receive(timeout_s=0.033)
        if news.new_session or news.servo_ended:
            anchor = None                     # another run: forget the contact
        if news.tool_state:
            p = news.tool_state.position_W_m
            if anchor is None and sum(x * x for x in p) < 0.005**2:
                anchor = p                    # the tool touches
            force = [-100 * (x - a) for x, a in zip(p, anchor or p)]
            link.answer(news.tool_state, force, in_contact=anchor is not None, converged=True,
                        contact_epoch=anchor is not None, contact_point_W_m=anchor)
        while link.next_query():              # answer() takes queries, too; they may go unanswered
            pass

Units are SI; vectors are (x, y, z) in the workspace frame W: x toward the operator, y to the operator's
right, z up. Quaternions are (w, x, y, z). A servo whose device has a wrist tells its tool's orientation
and takes torques (version 3 of the protocol). Version 4 is dropped; a servo that tries it falls back to
3 or 1 within 1.2 s. Not thread-safe.
"""
import collections
import dataclasses
import hashlib
import ipaddress
import math
import os
import secrets
import select
import socket
import stat
import struct
import time
import zlib

TOOL_STATE, QUERY, FORCE_SAMPLE, GOODBYE, SURFACE_PATCH = 1, 2, 3, 4, 5
_HEADER = struct.Struct("<4sHHHHIQ")  # magic, version, type, payload bytes, reserved, sequence, session
_PAYLOADS = {TOOL_STATE: struct.Struct("<q6d"), QUERY: struct.Struct("<q3d"),
             FORCE_SAMPLE: struct.Struct("<qIIII9d2d9d"), GOODBYE: struct.Struct("<"),
             SURFACE_PATCH: struct.Struct("<qIIBBBB2f6f3d57f81B")}
_POSE_PAYLOADS = {**_PAYLOADS, TOOL_STATE: struct.Struct("<q13dII"),
                  FORCE_SAMPLE: struct.Struct("<qIIII9d2d9d3d4d9d")}
_POSITION, _POSE = 1, 3  # versions of the protocol
_MAX_DATAGRAM_BYTES = 511
_MAX_POSITION_M, _MAX_VELOCITY_M_PER_S, _MAX_FORCE_N, _MAX_STIFFNESS_N_PER_M = 10.0, 100.0, 1e3, 1e7
_MAX_SOLVE_TIME_S = 3600.0
_MAX_ANGULAR_VELOCITY_RAD_PER_S, _MAX_TORQUE_NM, _MAX_ROTATIONAL_STIFFNESS_NM_PER_RAD = 1e3, 1e3, 1e7
_MAX_NORM_ERROR, _IDENTITY = 1e-6, (1.0, 0.0, 0.0, 0.0)
_MAX_VERTICES, _MAX_TRIANGLES, _MAX_OFFSET_M = 19, 27, 1.0
_MAX_TOOL_RADIUS_M, _MAX_TOOL_LENGTH_M, _MAX_TOOL_OPENING_RAD = 0.1, 0.5, 1.6
_QUEUED_QUERIES, _REMEMBERED_SESSIONS, _WINDOW, _PEER_STREAMS = 64, 16, 1024, 16

_SEAL_HEAD = struct.Struct("<4sHBB8s16sQ16s")  # magic, version, direction, 0, key id, stream, counter, heard
_SEAL_TIMES = struct.Struct("<qqq")
_SEAL_BYTES = _SEAL_HEAD.size + _SEAL_TIMES.size + 16
_FROM_SERVO, _FROM_SIMULATOR = 1, 2


class LinkError(Exception):
    """The link cannot be set up. The text says what to do."""


@dataclasses.dataclass(frozen=True)
class ToolState:
    sequence: int
    servo_time_ns: int
    position_W_m: tuple
    velocity_W_m_per_s: tuple
    orientation_WT: tuple = _IDENTITY  # of the rotation from the tool's frame T to W
    angular_velocity_W_rad_per_s: tuple = (0.0, 0.0, 0.0)
    buttons: int = 0                   # bit i: the device's button i is pressed
    has_orientation: bool = False      # else the identity and no angular velocity
    has_buttons: bool = False


@dataclasses.dataclass(frozen=True)
class Query:
    query_id: int
    servo_time_ns: int
    position_W_m: tuple


@dataclasses.dataclass
class News:
    """What receive() found. Everything is empty after a time-out."""
    tool_state: ToolState = None  # the newest, if it arrived since the last call
    new_session: bool = False     # another run of a servo began: forget what belongs to the last one
    servo_ended: bool = False     # the servo said goodbye


def _ahead_of(a, b):
    """How far a is ahead of b on the circle of 32 bits (RFC 1982)."""
    return (a - b + 2**31) % 2**32 - 2**31


def _within(values, bound):
    return all(math.isfinite(value) and abs(value) <= bound for value in values)


def _is_unit(quaternion):
    return abs(sum(component * component for component in quaternion) - 1.0) <= _MAX_NORM_ERROR


class _Refused(Exception):
    """The datagram is dropped. The text names the counter."""


def _check_pose(payload):
    """Refuses an unsound tool state of version 3."""
    orientation, angular_velocity, (buttons, flags) = payload[7:11], payload[11:14], payload[14:]
    if flags > 3 or (not flags & 2 and buttons) or (
            not flags & 1 and (orientation != _IDENTITY or any(angular_velocity))):
        raise _Refused("reserved field not zero")
    if not (_within(orientation, 2.0) and _is_unit(orientation)
            and _within(angular_velocity, _MAX_ANGULAR_VELOCITY_RAD_PER_S)):
        raise _Refused("out of range")


def decode(datagram):
    """(version, type, sequence, session, payload) of a valid datagram. Raises _Refused for any other."""
    if len(datagram) < _HEADER.size + 4:
        raise _Refused("too short")
    magic, version, kind, length, reserved, sequence, session = _HEADER.unpack_from(datagram)
    if magic != b"FGRD":
        raise _Refused("bad magic")
    if version not in (_POSITION, _POSE):
        raise _Refused("bad version")
    payloads = _POSE_PAYLOADS if version == _POSE else _PAYLOADS
    if kind not in payloads:
        raise _Refused("bad type")
    if len(datagram) != _HEADER.size + payloads[kind].size + 4 or length != payloads[kind].size:
        raise _Refused("bad length")
    if zlib.crc32(datagram[:-4]) != struct.unpack("<I", datagram[-4:])[0]:
        raise _Refused("bad checksum")
    if reserved != 0 or (kind == GOODBYE and sequence != 0):
        raise _Refused("reserved field not zero")
    payload = payloads[kind].unpack_from(datagram, _HEADER.size)
    if session == 0 or (kind == QUERY and sequence == 0) or (payload and payload[0] < 0) or (
            kind in (TOOL_STATE, QUERY) and not _within(payload[1:4], _MAX_POSITION_M)) or (
            kind == TOOL_STATE and not _within(payload[4:7], _MAX_VELOCITY_M_PER_S)):
        raise _Refused("out of range")
    if version == _POSE and kind == TOOL_STATE:
        _check_pose(payload)
    return version, kind, sequence, session, payload


def encode(version, kind, sequence, session, *payload):
    layout = (_POSE_PAYLOADS if version == _POSE else _PAYLOADS)[kind]
    body = _HEADER.pack(b"FGRD", version, kind, layout.size, 0, sequence, session) + layout.pack(*payload)
    return body + struct.pack("<I", zlib.crc32(body))


class _Window:
    """A replay window: each counter passes once."""

    def __init__(self):
        self.newest, self.passed = 0, 0

    def let_pass(self, counter):
        back = self.newest - counter
        if back < 0:
            self.passed = (self.passed << min(-back, _WINDOW) | 1) & (1 << _WINDOW) - 1
            self.newest = counter
            return True
        if counter == 0 or back >= _WINDOW or self.passed >> back & 1:
            return False
        self.passed |= 1 << back
        return True


class _Numbers:
    """The same for 32-bit numbers that wrap (RFC 1982). Refuses a number seen before or far too old."""

    def __init__(self):
        self._window = _Window()

    def take(self, number):
        newest = self._window.newest or 2**32 + number
        unwrapped = newest + _ahead_of(number, newest % 2**32)
        if not self._window.let_pass(unwrapped):
            raise _Refused("duplicated" if self._window.newest - unwrapped < _WINDOW else "late")


class _Peer:
    """The receiver of a sealed datagram."""

    def __init__(self, key_id, stream, sent_ns, received_ns):
        self.key_id, self.stream, self.sent_ns, self.received_ns = key_id, stream, sent_ns, received_ns


class _Stale(_Refused):
    """Authentic, but the sender does not know this end's stream yet."""

    def __init__(self, peer):
        super().__init__("seal: stale")
        self.peer = peer


def load_key(file):
    """(key id, secret) from a file made by `forcegrid keygen`. Raises LinkError."""
    try:
        with open(file, "rb") as opened:
            status = os.fstat(opened.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise LinkError("link key file '%s': is not a regular file" % file)
            if status.st_mode & 0o077:
                raise LinkError("link key file '%s': others may use it; run: chmod 600 '%s'" % (file, file))
            if status.st_uid not in (0, os.geteuid()):
                raise LinkError("link key file '%s': belongs to another user; run: sudo chown $USER '%s'"
                                % (file, file))
            words = opened.read(104).decode("ascii", "replace").split(" ")
    except OSError as error:
        raise LinkError("link key file '%s': %s; make one with 'forcegrid keygen FILE'"
                        % (file, error.strerror)) from error
    try:
        tag, key_id, secret = words[0], bytes.fromhex(words[1]), bytes.fromhex(words[2])
    except (IndexError, ValueError):
        tag, key_id, secret = "", b"", b""
    right_id = hashlib.blake2b(b"forcegrid link key id", key=secret, digest_size=16).digest()[:8]
    if tag != "forcegrid-link-key-1" or len(secret) != 32 or key_id != right_id:
        raise LinkError("link key file '%s': holds no key, or a damaged one; copy it again" % file)
    return key_id, secret


class _Channel:
    """Seals and opens datagrams: "Sealed datagrams" in docs/link_protocol.md."""

    def __init__(self, key_files):
        try:
            from nacl import bindings
        except ImportError as error:
            raise LinkError("a link with a key needs PyNaCl: apt-get install python3-nacl") from error
        self._encrypt = bindings.crypto_aead_xchacha20poly1305_ietf_encrypt
        self._decrypt = bindings.crypto_aead_xchacha20poly1305_ietf_decrypt
        self._error = __import__("nacl.exceptions").exceptions.CryptoError
        self._keys = dict(load_key(file) for file in key_files)
        self._begin_stream()

    def _begin_stream(self):
        self._stream, self._counter, self._windows = secrets.token_bytes(16), 0, {}

    def open(self, sealed):
        """(datagram, peer); the datagram is empty in a hello. Raises _Refused."""
        if sealed[:4] != b"FGRS":
            raise _Refused("seal: not sealed")
        if len(sealed) < _SEAL_BYTES:
            raise _Refused("seal: too short")
        _, version, direction, reserved, key_id, stream, counter, heard = _SEAL_HEAD.unpack_from(sealed)
        if version != 1:
            raise _Refused("seal: bad version")
        if direction != _FROM_SERVO or reserved != 0:
            raise _Refused("seal: bad direction")
        if key_id not in self._keys:
            raise _Refused("seal: unknown key")
        head = sealed[:_SEAL_HEAD.size]
        try:
            inside = self._decrypt(sealed[_SEAL_HEAD.size:], head, head[16:40], self._keys[key_id])
        except self._error:
            raise _Refused("seal: forged") from None
        peer = _Peer(key_id, stream, _SEAL_TIMES.unpack_from(inside)[0], time.monotonic_ns())
        if heard != self._stream:
            raise _Stale(peer)
        if stream not in self._windows:
            if len(self._windows) == _PEER_STREAMS:
                self._begin_stream()
                raise _Stale(peer)
            self._windows[stream] = _Window()
        if not self._windows[stream].let_pass(counter):
            raise _Refused("seal: replayed")
        return inside[_SEAL_TIMES.size:], peer

    def seal(self, datagram, peer):
        self._counter += 1
        head = _SEAL_HEAD.pack(b"FGRS", 1, _FROM_SIMULATOR, 0, peer.key_id, self._stream, self._counter,
                               peer.stream)
        times = _SEAL_TIMES.pack(time.monotonic_ns(), peer.sent_ns, peer.received_ns)
        return head + self._encrypt(times + datagram, head, head[16:40], self._keys[peer.key_id])


class SimulatorLink:
    """The simulator's end: serves one servo at a time. See the top of this file."""

    def __init__(self, host="127.0.0.1", port=24870, key_files=(), silence_s=2.0):
        """Listens at host:port. Port 0 takes a free one. After silence_s without a word from the servo
        another servo may take the link. Without a key only loopback addresses are accepted: such a
        link is not authenticated, and forces move real motors. Raises LinkError or OSError."""
        host = "127.0.0.1" if host == "localhost" else host
        try:
            loopback = ipaddress.ip_address(host).is_loopback
        except ValueError:
            raise LinkError("'%s' is not a numeric IP address; write 127.0.0.1, ::1 or, with a key, another "
                            "address of this machine (names are not looked up)" % host) from None
        if not key_files and not loopback:
            raise LinkError("'%s' is not a loopback address; a link that leaves this machine needs a key: "
                            "run 'forcegrid keygen FILE' and give the file to both ends" % host)
        self._channel = _Channel(key_files) if key_files else None
        self._socket = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((host, port))
        self._socket.setblocking(False)
        self._silence_s = silence_s
        self._servo = self._peer = None
        self._session, self._ended = 0, collections.deque(maxlen=_REMEMBERED_SESSIONS)
        self._version = _POSITION  # in which the servo is answered
        self._last_heard_s = 0.0
        self._sequence = self._patches = 0
        self.dropped = collections.Counter()  # reason -> datagrams
        self._forget()

    @property
    def port(self):
        return self._socket.getsockname()[1]

    def receive(self, timeout_s):
        """Takes in everything that has arrived. Waits up to timeout_s if there is nothing."""
        news = News()
        deadline_s = time.monotonic() + timeout_s
        while True:
            took = False
            for _ in range(4096):  # a flood must not hold the simulator
                try:
                    datagram, sender = self._socket.recvfrom(_MAX_DATAGRAM_BYTES + 1)
                except (BlockingIOError, ConnectionRefusedError):
                    break
                try:
                    self._take(datagram, sender, news)
                    took = True
                except _Stale as stale:
                    self.dropped[str(stale)] += 1
                    self._send_to(sender, b"", stale.peer)  # a hello: it names our stream
                except _Refused as reason:
                    self.dropped[str(reason)] += 1
            left_s = deadline_s - time.monotonic()
            if took or left_s <= 0 or not select.select([self._socket], [], [], left_s)[0]:
                return news

    def next_query(self):
        """The oldest waiting query of the current session, or None."""
        return self._queries.popleft() if self._queries else None

    def answer(self, request, force_W_N, in_contact, converged, stiffness_W_N_per_m=None,
               position_W_m=None, contact_point_W_m=None, contact_epoch=0, relative_residual=0.0,
               solve_time_s=0.0, torque_W_Nm=None, orientation_WT=None,
               rotational_stiffness_W_Nm_per_rad=None):
        """Answers a ToolState or a Query: force_W_N is the force of the object on the tool.

        position_W_m: where the force was computed; default: the request's position.
        in_contact: the tool touches the object. Say False, with zero force, while the tool is free.
        contact_epoch: 0 before any contact, then a new number at every discontinuity; in the answer
        to a query that of the present contact. contact_point_W_m: where the tool touched.
        stiffness_W_N_per_m: dF/dP, 9 numbers row by row. converged: the solver reached its tolerance.
        torque_W_Nm: on the tool about position_W_m; a servo without a wrist does not get it.
        orientation_WT: for which it was computed; default: the request's.
        rotational_stiffness_W_Nm_per_rad, with a torque only: d(torque)/d(theta), 9 numbers row by
        row; theta is the rotation vector in W by which the tool turns on.
        Raises ValueError for what the servo would refuse."""
        position_W_m = tuple(request.position_W_m if position_W_m is None else position_W_m)
        contact_point_W_m = tuple(position_W_m if contact_point_W_m is None else contact_point_W_m)
        stiffness = tuple([0.0] * 9 if stiffness_W_N_per_m is None else stiffness_W_N_per_m)
        if not (_within(position_W_m, _MAX_POSITION_M) and _within(contact_point_W_m, _MAX_POSITION_M)
                and _within(force_W_N, _MAX_FORCE_N) and _within(stiffness, _MAX_STIFFNESS_N_PER_M)
                and 0.0 <= relative_residual < math.inf and 0.0 <= solve_time_s <= _MAX_SOLVE_TIME_S):
            raise ValueError("the answer is not finite or out of range; see docs/link_protocol.md")
        torque = self._torque_fields(request, torque_W_Nm, orientation_WT, rotational_stiffness_W_Nm_per_rad)
        if self._session == 0:
            return  # the servo has gone
        is_query = isinstance(request, Query)
        flags = bool(in_contact) | bool(converged) << 1 | (stiffness_W_N_per_m is not None) << 2
        self._sequence = (self._sequence + 1) % 2**32
        if self._version == _POSE:
            flags |= (torque_W_Nm is not None) << 3 | (rotational_stiffness_W_Nm_per_rad is not None) << 4
        else:
            torque = ()
        self._send(encode(self._version, FORCE_SAMPLE, self._sequence, self._session, request.servo_time_ns,
                          0 if is_query else request.sequence, request.query_id if is_query else 0,
                          contact_epoch, flags, *position_W_m, *force_W_N, *contact_point_W_m,
                          relative_residual, solve_time_s, *stiffness, *torque))

    @staticmethod
    def _torque_fields(request, torque_W_Nm, orientation_WT, rotational_stiffness_W_Nm_per_rad):
        """Torque, orientation and rotational stiffness of a sample of version 3. Raises ValueError."""
        stiffness = tuple([0.0] * 9 if rotational_stiffness_W_Nm_per_rad is None
                          else rotational_stiffness_W_Nm_per_rad)
        if torque_W_Nm is None:
            if rotational_stiffness_W_Nm_per_rad is not None:
                raise ValueError("rotational_stiffness_W_Nm_per_rad needs a torque_W_Nm")
            return (0.0, 0.0, 0.0, *_IDENTITY, *stiffness)
        orientation = tuple(getattr(request, "orientation_WT", _IDENTITY) if orientation_WT is None
                            else orientation_WT)
        if not (_within(torque_W_Nm, _MAX_TORQUE_NM) and _within(orientation, 2.0)
                and len(orientation) == 4 and _is_unit(orientation)
                and _within(stiffness, _MAX_ROTATIONAL_STIFFNESS_NM_PER_RAD)):
            raise ValueError("the torque is not finite or out of range, or orientation_WT is not a unit "
                             "quaternion; see docs/link_protocol.md")
        return (*torque_W_Nm, *orientation, *stiffness)

    def show_surface(self, tool_state, vertices_W_m, triangles, contact_epoch=0, tool_radius_m=0.0,
                     tool_length_m=0.0, stiffness_W_N_per_m=None, press_forces_W_N=None,
                     tool_opening_rad=0.0):
        """Sends the part of the surface that a tool in the air may touch next. Optional.

        vertices_W_m: at most 19; triangles: at most 27, each three vertex numbers, counterclockwise
        seen from outside. contact_epoch: that of the samples in the air. stiffness_W_N_per_m: dF/dP
        of a tool that has just touched there: xx, yy, zz, xy, xz, yz. press_forces_W_N, in place of
        it for a tool that slides: the two forces on a tool that has gone straight on from there and
        is 1 and 2 mm deep along the outward normal. tool_opening_rad: above 0 the tool is a grasper,
        two rods that meet in a hinge; sent in steps of 0.01 rad. Raises ValueError for what the
        servo would refuse."""
        offsets = [vertex[axis] - tool_state.position_W_m[axis] for vertex in vertices_W_m
                   for axis in range(3)]
        corners = [corner for triangle in triangles for corner in triangle]
        stiffness = tuple([0.0] * 6 if stiffness_W_N_per_m is None else stiffness_W_N_per_m)
        slides = press_forces_W_N is not None
        press = [component for force in press_forces_W_N for component in force] if slides else []
        flags = (stiffness_W_N_per_m is not None) | slides << 1
        if not (flags < 3 and len(press) == 6 * slides and _within(press, _MAX_FORCE_N)
                and 0.0 <= tool_opening_rad <= _MAX_TOOL_OPENING_RAD
                and len(vertices_W_m) <= _MAX_VERTICES and len(triangles) <= _MAX_TRIANGLES
                and len(corners) == 3 * len(triangles)
                and all(0 <= corner < len(vertices_W_m) for corner in corners)
                and _within(offsets, _MAX_OFFSET_M) and _within(stiffness, _MAX_STIFFNESS_N_PER_M)
                and 0.0 <= tool_radius_m <= _MAX_TOOL_RADIUS_M
                and 0.0 <= tool_length_m <= _MAX_TOOL_LENGTH_M):
            raise ValueError("the patch is too large, not finite or out of range; see "
                             "docs/link_protocol.md")
        if self._session == 0:
            return  # the servo has gone
        self._patches = (self._patches + 1) % 2**32
        self._send(encode(self._version, SURFACE_PATCH, self._patches, self._session,
                          tool_state.servo_time_ns, tool_state.sequence, contact_epoch,
                          len(vertices_W_m), len(triangles), flags, round(100 * tool_opening_rad),
                          tool_radius_m, tool_length_m, *(press or stiffness),
                          *tool_state.position_W_m, *offsets,
                          *[0.0] * (3 * _MAX_VERTICES - len(offsets)), *corners,
                          *[0] * (3 * _MAX_TRIANGLES - len(corners))))

    def close(self):
        """Says goodbye to the servo, if there is one, and closes the socket."""
        if self._session:
            self._send(encode(self._version, GOODBYE, 0, self._session))
            self._session = 0
        self._socket.close()

    def _forget(self):
        if self._session:
            self._ended.append(self._session)
        self._session = 0
        self._tool_states, self._query_ids = _Numbers(), _Numbers()
        self._newest = None
        self._version = _POSITION
        self._queries = collections.deque()

    def _take(self, datagram, sender, news):
        if len(datagram) > _MAX_DATAGRAM_BYTES:
            raise _Refused("bad length")
        peer = None
        if self._channel:
            datagram, peer = self._channel.open(datagram)
            if not datagram:
                return
        version, kind, sequence, session, payload = decode(datagram)
        if kind in (FORCE_SAMPLE, SURFACE_PATCH):
            raise _Refused("unexpected type")
        self._check_session(kind, session, sender, news)
        self._peer = peer
        self._version = max(self._version, version)
        if kind == GOODBYE:
            self._forget()
            news.tool_state, news.servo_ended = None, True
        elif kind == TOOL_STATE:
            self._tool_states.take(sequence)
            if self._newest is not None and _ahead_of(sequence, self._newest.sequence) < 0:
                raise _Refused("late")
            self._newest = news.tool_state = self._tool_state(version, sequence, payload)
        else:
            self._query_ids.take(sequence)
            self._queries.append(Query(sequence, payload[0], payload[1:4]))
            if len(self._queries) > _QUEUED_QUERIES:
                self._queries.popleft()
                self.dropped["queue full"] += 1

    def _tool_state(self, version, sequence, payload):
        position = (sequence, payload[0], payload[1:4], payload[4:7])
        if version == _POSE:
            return ToolState(*position, payload[7:11], payload[11:14], payload[14], bool(payload[15] & 1),
                             bool(payload[15] & 2))
        if self._newest is None:
            return ToolState(*position)
        return dataclasses.replace(self._newest, sequence=sequence, servo_time_ns=payload[0],
                                   position_W_m=payload[1:4], velocity_W_m_per_s=payload[4:7])

    def _check_session(self, kind, session, sender, news):
        if session == self._session:
            if sender != self._servo:
                raise _Refused("foreign address")
        else:
            alive = self._session and time.monotonic() - self._last_heard_s < self._silence_s
            if kind == GOODBYE or session in self._ended or (alive and sender != self._servo):
                raise _Refused("foreign session")
            self._forget()
            self._session, self._servo = session, sender
            news.tool_state, news.new_session = None, True
        self._last_heard_s = time.monotonic()

    def _send(self, datagram):
        self._send_to(self._servo, datagram, self._peer)

    def _send_to(self, address, datagram, peer):
        try:
            self._socket.sendto(self._channel.seal(datagram, peer) if self._channel else datagram, address)
        except (BlockingIOError, ConnectionRefusedError):
            self.dropped["not sent"] += 1
