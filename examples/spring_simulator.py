#!/usr/bin/env python3
"""A plain spring as a simulator for Forcegrid: F = -k (P - P0), P0 being where the tool was first.

usage: spring_simulator.py PORT [STIFFNESS_N_PER_M]     (every byte: docs/link_protocol.md)"""
import signal, socket, struct, sys, time, zlib

HEADER = "<4sHHHHIQ"  # magic, version, type, payload bytes, reserved, sequence, session id
TOOL_STATE, FORCE_SAMPLE = HEADER + "q3d3d", HEADER + "qIIII3d3d3ddd9d"
PERIOD_S = 1 / 30

signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends it without a trace
link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
link.bind(("127.0.0.1", int(sys.argv[1])))  # loopback only: this link is not authenticated
stiffness_N_per_m = float(sys.argv[2]) if len(sys.argv) > 2 else 100.0
print("listening on 127.0.0.1:%d" % link.getsockname()[1], flush=True)
session, first_W_m, sequence = None, None, 0
while True:
    newest, servo = None, None
    link.settimeout(None)  # wait for the first tool state, then skip to the newest one
    try:
        while True:
            datagram, sender = link.recvfrom(512)
            body, (crc,) = datagram[:-4], struct.unpack("<I", datagram[-4:].rjust(4, b"\0"))
            if len(body) == struct.calcsize(TOOL_STATE) and zlib.crc32(body) == crc:
                fields = struct.unpack(TOOL_STATE, body)
                if fields[:3] == (b"FGRD", 1, 1):
                    newest, servo = fields, sender
            link.settimeout(0 if newest else None)
    except BlockingIOError:
        pass
    echo_sequence, new_session, time_ns, *position_W_m = newest[5:11]
    if new_session != session:
        session, first_W_m = new_session, position_W_m
    force_W_N = [-stiffness_N_per_m * (p - p0) for p, p0 in zip(position_W_m, first_W_m)]
    matrix = [stiffness_N_per_m * -(i % 4 == 0) for i in range(9)]  # dF/dP, row major
    sequence += 1
    body = struct.pack(FORCE_SAMPLE, b"FGRD", 1, 3, 184, 0, sequence, session, time_ns, echo_sequence,
                       0, 1, 7, *position_W_m, *force_W_N, *first_W_m, 0.0, 0.0, *matrix)
    link.sendto(body + struct.pack("<I", zlib.crc32(body)), servo)
    time.sleep(PERIOD_S - time.monotonic() % PERIOD_S)
