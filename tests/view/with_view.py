# SPDX-License-Identifier: Apache-2.0
"""What the tests of the program forcegrid-view have in common; its file is their first argument."""
import pathlib
import struct
import sys
import unittest

from peers import Page, Run, View, http

PROGRAM = sys.argv.pop(1)
SEED = 20261124


class WithView(unittest.TestCase):
    def setUp(self):
        self.view = View(PROGRAM)
        self.addCleanup(self.end)

    def end(self):
        """Whatever a test did, the program still serves, ends well, and leaves no folder."""
        self.assertEqual(http(self.view, "/?token=" + self.view.token)[0], 200, self.view.said())
        folder = pathlib.Path(self.view.folder)
        self.assertEqual(self.view.close(), 0)
        self.assertFalse(folder.exists())

    def live_page(self, run=None):
        """A page that shows a run, and the run."""
        run = run or Run(self.view)
        self.addCleanup(run.connection.close)
        page = Page(self.view)
        self.addCleanup(page.connection.close)
        self.assertEqual(page.status, 101)
        page.receive_type("hello")
        return page, run


def rows_of(message, columns):
    """Rows of a scope message, by the names of the columns."""
    kind, count, width, base_s = struct.unpack_from("<BxHId", message)
    if (kind, width, len(message)) != (1, len(columns), 16 + 4 * count * width):
        raise AssertionError("no scope message: %r" % message[:16])
    for row in range(count):
        numbers = struct.unpack_from("<%df" % width, message, 16 + 4 * width * row)
        values = dict(zip(columns, numbers))
        yield {**values, "time_s": values["time_s"] + base_s}
