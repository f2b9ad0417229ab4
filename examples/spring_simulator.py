#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A spring for Forcegrid: F = -k (P - P0), with P0 where it catches the tool near W's origin.
usage: spring_simulator.py PORT [STIFFNESS_N_PER_M]     (every byte: docs/link_protocol.md)"""
import signal, socket, struct, sys, time, zlib

HEADER = "<4sHHHHIQ"  # magic, version, type, payload bytes, reserved, sequence, session id
TOOL_STATE, FORCE_SAMPLE = HEADER + "q3d3d", HEADER + "qIIII3d3d3ddd9d"
PERIOD_S, REACH_M = 1 / 30, 0.005  # the spring catches a tool this near to the origin

signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends it without a traceback
link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
link.bind(("127.0.0.1", int(sys.argv[1])))  # loopback only: this link is not authenticated
stiffness_N_per_m = float((sys.argv + ["100"])[2])
print("listening on 127.0.0.1:%d" % link.getsockname()[1], flush=True)
session, first_W_m, sequence = None, None, 0
while True:
    newest = link.settimeout(None)  # None; wait for a tool state, then skip to the newest one
    try:
        while True:
            datagram, sender = link.recvfrom(512)
            body, (crc,) = datagram[:-4], struct.unpack("<I", datagram[-4:].rjust(4, b"\0"))
            is_tool_state = body[:8] == b"FGRD\1\0\1\0" and len(body) == struct.calcsize(TOOL_STATE)
            if is_tool_state and zlib.crc32(body) == crc:
                newest, servo = struct.unpack(TOOL_STATE, body), sender
            link.settimeout(0 if newest else None)
    except BlockingIOError:
        pass
    echo_sequence, new_session, time_ns, *position_W_m = newest[5:11]
    if new_session != session:
        session, first_W_m = new_session, None
    if first_W_m is None and sum(p * p for p in position_W_m) < REACH_M**2:
        first_W_m = position_W_m
    held, origin_W_m = first_W_m is not None, first_W_m or position_W_m
    force_W_N = [-stiffness_N_per_m * (p - p0) for p, p0 in zip(position_W_m, origin_W_m)]
    matrix = [-stiffness_N_per_m if held and i % 4 == 0 else 0.0 for i in range(9)]  # dF/dP
    sequence, flags = sequence + 1, 7 if held else 2
    body = struct.pack(FORCE_SAMPLE, b"FGRD", 1, 3, 184, 0, sequence, session, time_ns, echo_sequence, 0,
                       held, flags, *position_W_m, *force_W_N, *origin_W_m, 0.0, 0.0, *matrix)
    link.sendto(body + struct.pack("<I", zlib.crc32(body)), servo)
    time.sleep(PERIOD_S - time.monotonic() % PERIOD_S)
