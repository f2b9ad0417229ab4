#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Joins a device's serial line to a simulator: each SLIP frame (RFC 1055) is one datagram.
usage: serial_bridge.py LINE HOST:PORT    LINE: a serial port at 1 Mbit/s, or unix:FILE"""
import os
import select
import socket
import sys
import termios
import tty

END, ESCAPE = b"\xc0", b"\xdb"
LONGEST = 511  # bytes of a datagram


def open_line(name):
    """A file descriptor of the line, raw."""
    if name.startswith("unix:"):
        line = socket.socket(socket.AF_UNIX)
        line.connect(name[len("unix:"):])
        return line.detach()
    line = os.open(name, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(line)
    settings = termios.tcgetattr(line)
    settings[4] = settings[5] = termios.B1000000
    termios.tcsetattr(line, termios.TCSANOW, settings)
    return line


def framed(datagram):
    return datagram.replace(ESCAPE, ESCAPE + b"\xdd").replace(END, ESCAPE + b"\xdc") + END


def unframed(frame):
    return frame.replace(ESCAPE + b"\xdc", END).replace(ESCAPE + b"\xdd", ESCAPE)


def write_all(line, data):
    while data:
        data = data[os.write(line, data):]


def main():
    if len(sys.argv) != 3:
        raise SystemExit(__doc__)
    line = open_line(sys.argv[1])
    host, port = sys.argv[2].rsplit(":", 1)
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.connect((host, int(port)))
    waiting = b""
    while True:
        for ready in select.select([line, link], [], [])[0]:
            try:
                if ready is link:
                    write_all(line, framed(link.recv(LONGEST + 1)))
                    continue
                read = os.read(line, 4096)
                if not read:
                    return  # the line is closed
                *frames, waiting = (waiting + read).split(END)
                for frame in frames:
                    if 0 < len(frame) <= 2 * LONGEST:
                        link.send(unframed(frame))
                waiting = waiting[-2 * LONGEST:]
            except ConnectionRefusedError:
                pass  # no simulator yet


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        pass
