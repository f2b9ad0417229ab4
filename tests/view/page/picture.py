# SPDX-License-Identifier: Apache-2.0
"""Pixels of a PNG file and convex outlines, with the standard library."""
import math
import struct
import zlib


class Picture:
    """Eight-bit RGB or RGBA without interlace, as browsers write it."""

    def __init__(self, png):
        if png[:8] != b"\x89PNG\r\n\x1a\n":
            raise ValueError("no PNG")
        at, data = 8, b""
        while at < len(png):
            size, kind = struct.unpack_from(">I4s", png, at)
            body = png[at + 8:at + 8 + size]
            if kind == b"IHDR":
                self.width, self.height, depth, colour, _, _, interlace = struct.unpack(
                    ">IIBBBBB", body)
                if depth != 8 or colour not in (2, 6) or interlace:
                    raise ValueError("a PNG of a kind that this does not read")
                self.channels = 3 if colour == 2 else 4
            elif kind == b"IDAT":
                data += body
            at += size + 12
        self.rows = self.unfilter(zlib.decompress(data))

    def unfilter(self, data):
        size, step = self.width * self.channels, self.channels
        rows, above = [], bytearray(size)
        for start in range(0, len(data), size + 1):
            kind, row = data[start], bytearray(data[start + 1:start + 1 + size])
            if kind == 1:
                for i in range(step, size):
                    row[i] = (row[i] + row[i - step]) & 255
            elif kind == 2:
                row = bytearray((a + b) & 255 for a, b in zip(row, above))
            elif kind == 3:
                for i in range(size):
                    row[i] = (row[i] + ((row[i - step] if i >= step else 0) + above[i]) // 2) & 255
            elif kind == 4:
                for i in range(size):
                    a, c = (row[i - step], above[i - step]) if i >= step else (0, 0)
                    b = above[i]
                    pa, pb, pc = abs(b - c), abs(a - c), abs(a + b - 2 * c)
                    row[i] = (row[i] + (a if pa <= pb and pa <= pc else b if pb <= pc else c)) & 255
            rows.append(row)
            above = row
        return rows

    def at(self, x, y):
        start = int(x) * self.channels
        return tuple(self.rows[int(y)][start:start + 3])


def outline(points):
    """The convex outline of points (x, y), counter-clockwise in a frame with y up."""
    def half(ordered):
        chain = []
        for p in ordered:
            while len(chain) > 1 and cross(chain[-2], chain[-1], p) <= 0:
                chain.pop()
            chain.append(p)
        return chain[:-1]
    ordered = sorted(set(points))
    return half(ordered) + half(ordered[::-1])


def cross(a, b, p):
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])


def depth_inside(corners, p):
    """Distance of p from the nearest side's line: positive inside of the outline."""
    sides = zip(corners, corners[1:] + corners[:1])
    return min(cross(a, b, p) / max(1e-9, math.dist(a, b)) for a, b in sides)
