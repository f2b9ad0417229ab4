#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The stubs beside the module, by mypy and its stubtest, and by the signatures in the docstrings:
stubtest does not see those of functions that pybind11 made. And programs that use the stubs.
usage: stubs_test.py SOURCE_FOLDER [TEST ...]"""
import ast
import inspect
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

import forcegrid

ROOT = pathlib.Path(sys.argv[1])
PACKAGE = pathlib.Path(forcegrid.__file__).parent
HERE = pathlib.Path(__file__).resolve().parent
# What stubtest says of every class of pybind11, whose metaclass has no name in Python, and of those
# that a program can't make, whose constructor test_says_which_classes_no_program_can_make tries.
OF_PYBIND11 = re.compile(r"metaclass differs$|\.__init__ is inconsistent, stub does not have \*args ")
PLAIN = {"int", "float", "bool", "str", "None"}  # types with one name in stubs and docstrings


def run_mypy(module, *arguments, folder):
    """(exit status, lines) with the package's stubs, in a folder that has mypy's cache."""
    environment = {**os.environ, "MYPYPATH": str(PACKAGE.parent), "MYPY_CACHE_DIR": folder}
    done = subprocess.run([sys.executable, "-m", module, *arguments], text=True, cwd=folder,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=environment)
    return done.returncode, done.stdout.splitlines()


def as_function(text):
    """The syntax tree of "name(self: Type, ...) -> Type"."""
    return ast.parse(f"def {text}: ...").body[0]


def parameters(function):
    """[(name, kind, default as text or None, annotation as text)] without self."""
    arguments = function.args
    positional = arguments.posonlyargs + arguments.args
    defaults = [None] * (len(positional) - len(arguments.defaults)) + arguments.defaults
    rows = [(a, "positional", d) for a, d in zip(positional, defaults)]
    if arguments.vararg:
        rows.append((ast.arg("*"), "", None))  # of what name is all the same to a caller
    rows += [(a, "keyword", d) for a, d in zip(arguments.kwonlyargs, arguments.kw_defaults)]
    if arguments.kwarg:
        rows.append((ast.arg("**"), "", None))
    return [(a.arg, kind, default and ast.unparse(default),
             ast.unparse(a.annotation) if getattr(a, "annotation", None) else "")
            for a, kind, default in rows if a.arg not in ("self", "arg0")]


def optional(annotation):
    return annotation.replace("Optional[", "").rstrip("]") + " | None" \
        if annotation.startswith("Optional[") else annotation


def compared(stub, runtime):
    """What is to be alike: names, kinds, defaults, and the types that both name alike."""
    theirs = parameters(runtime)
    rows = []
    for i, (name, kind, default, annotation) in enumerate(parameters(stub)):
        known = i < len(theirs) and set(optional(theirs[i][3]).split(" | ")) <= PLAIN
        rows.append((name, kind, default, annotation if known and theirs[i][3] else ""))
    return rows, [(name, kind, default,
                   optional(annotation) if set(optional(annotation).split(" | ")) <= PLAIN else "")
                  for name, kind, default, annotation in theirs]


def returned(stub, runtime):
    """(of the stub, of the docstring), empty if the docstring's has no plain name."""
    theirs = optional(ast.unparse(runtime.returns)).replace("List[", "list[")
    theirs = theirs.replace("forcegrid._core.", "")
    named = theirs not in ("object", "tuple", "dict") and not theirs.startswith("numpy.")
    of_strings = re.sub(r"^Literal\['.*'\]$", "str", ast.unparse(stub.returns))
    return (of_strings, theirs) if named else ("", "")


class Stubs(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.tree = ast.parse((PACKAGE / "_core.pyi").read_text(encoding="utf-8"))

    def functions(self):
        """(name, stub, the first line of the docstring) of each function, method and property."""
        for node in self.tree.body:
            if isinstance(node, ast.FunctionDef):
                yield node.name, node, getattr(forcegrid, node.name).__doc__
            elif isinstance(node, ast.ClassDef):
                for inner in node.body:
                    if isinstance(inner, ast.FunctionDef):
                        there = inspect.getattr_static(getattr(forcegrid, node.name), inner.name)
                        text = there.fget.__doc__ if isinstance(there, property) else there.__doc__
                        yield f"{node.name}.{inner.name}", inner, text

    def test_agree_with_the_module(self):
        with tempfile.TemporaryDirectory() as folder:
            _, said = run_mypy("mypy.stubtest", "forcegrid", "--concise", folder=folder)
        self.assertTrue(said, "stubtest said nothing, not even what it says of pybind11's classes")
        self.assertEqual([line for line in said if not OF_PYBIND11.search(line)], [])

    def test_have_the_signatures_of_the_docstrings(self):
        count = 0
        for name, stub, text in self.functions():
            line = text.split("\n")[0]
            with self.subTest(function=name):
                runtime = as_function(line if not line.startswith("(") else stub.name + line)
                self.assertEqual(runtime.name, stub.name)
                self.assertEqual(*compared(stub, runtime))
                self.assertEqual(*returned(stub, runtime))
                count += 1
        self.assertGreater(count, 150)

    def test_have_the_numbers_of_the_enumerators(self):
        enums = [node for node in self.tree.body if isinstance(node, ast.ClassDef)
                 and [ast.unparse(base) for base in node.bases] == ["IntEnum"]]
        self.assertEqual(len(enums), 3)
        for node in enums:
            members = {inner.targets[0].id: ast.literal_eval(inner.value) for inner in node.body}
            self.assertEqual(members, dict(getattr(forcegrid, node.name).__members__))

    def test_are_called_different_where_they_are(self):
        runtime = as_function("f(self: object, a: int, b: float = 0.5, *, c: Optional[int] = None) -> bool")
        right = "f(self, a: int, b: float = 0.5, *, c: int | None = None) -> bool"
        self.assertEqual(*compared(as_function(right), runtime))
        self.assertEqual(*returned(as_function(right), runtime))
        for wrong in ("f(self, x: int, b: float = 0.5, *, c: int | None = None) -> bool",
                      "f(self, a: int, b: float = 0.25, *, c: int | None = None) -> bool",
                      "f(self, a: int, b: float, *, c: int | None = None) -> bool",
                      "f(self, a: int, b: float = 0.5, c: int | None = None) -> bool",
                      "f(self, a: int, b: float = 0.5, *, c: int = None) -> bool",
                      "f(self, a: str, b: float = 0.5, *, c: int | None = None) -> bool",
                      "f(self, a: int, b: float = 0.5) -> bool"):
            self.assertNotEqual(*compared(as_function(wrong), runtime))
        self.assertNotEqual(*returned(as_function("f(self) -> int"), runtime))

    def test_says_which_classes_no_program_can_make(self):
        for node in self.tree.body:
            there = getattr(forcegrid, node.name, None) if isinstance(node, ast.ClassDef) else None
            if there is None or type(there).__name__ != "pybind11_type":
                continue
            with self.subTest(type=node.name):
                made = any(getattr(inner, "name", "") == "__init__" for inner in node.body)
                self.assertEqual(made, "__init__" in vars(there)
                                 and type(vars(there)["__init__"]).__name__ == "instancemethod")
                if not made:
                    with self.assertRaisesRegex(TypeError, "No constructor"):
                        there()


class Clients(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = folder.name

    def test_are_accepted(self):
        programs = [*sorted((ROOT / "examples").glob("0*.py")), HERE / "typed_client.py"]
        self.assertGreater(len(programs), 4)
        status, said = run_mypy("mypy", "--strict", *map(str, programs), folder=self.folder)
        self.assertEqual(status, 0, "\n".join(said))

    def test_are_told_what_is_wrong(self):
        program = pathlib.Path(self.folder, "program.py")
        program.write_text("import forcegrid\n"
                           "forcegrid.Kinematics(7)\n"
                           "forcegrid.SimulatorLink(hosts='127.0.0.1')\n"
                           "forcegrid.make('auto').contact_mad()\n"
                           "with forcegrid.ServoLink('127.0.0.1:1') as link:\n"
                           "    link.receive().force_W_N\n", encoding="utf-8")
        _, said = run_mypy("mypy", "--strict", str(program), folder=self.folder)
        wrong = {int(found[1]): found[2] for line in said
                 if (found := re.search(r"program\.py:(\d+): error: .*\[([\w-]+)\]", line))}
        self.assertEqual(wrong, {2: "arg-type", 3: "call-arg", 4: "attr-defined", 6: "union-attr"})


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1] + sys.argv[2:])
