# SPDX-License-Identifier: Apache-2.0
"""What goes into the guest: its root folder, and what --shell or --run asks for."""

import os
import pathlib
import re
import shutil
import subprocess

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
# Where glibc looks for libraries without being told.
LIBRARY_FOLDERS = ("/lib", "/lib64", "/usr/lib", "/usr/lib64", "/lib/x86_64-linux-gnu",
                   "/usr/lib/x86_64-linux-gnu")


class HilError(Exception):
    """What went wrong and the remedy."""


def output_of(command, **options):
    """Standard output of a command that must succeed."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, **options)
    except FileNotFoundError as error:
        raise HilError(f"{command[0]}: not found; `make setup` installs it") from error
    if done.returncode != 0:
        raise HilError(f"`{' '.join(map(str, command))}` failed: {done.stderr.strip()}")
    return done.stdout


class Initramfs:
    """A folder that becomes the guest's root."""

    def __init__(self, folder):
        self.folder = folder

    def path(self, inside):
        path = self.folder / str(inside).lstrip("/")
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def add_text(self, inside, text, mode=0o644):
        path = self.path(inside)
        path.write_text(text, encoding="utf-8")
        path.chmod(mode)

    def add_file(self, source, inside, mode=None):
        path = self.path(inside)
        shutil.copyfile(source, path)
        path.chmod(mode if mode is not None else os.stat(source).st_mode & 0o755)

    def add_link(self, inside, target):
        path = self.path(inside)
        if not path.is_symlink() and not path.exists():
            path.symlink_to(target)

    def add_program(self, source, inside):
        """A program with the libraries that it is linked to."""
        self.add_file(source, inside, 0o755)
        self.add_libraries(source)

    def add_libraries(self, source):
        """The libraries of a program or library; none of a script or of what is linked statically."""
        listed = subprocess.run(["ldd", source], capture_output=True, text=True, check=False).stdout
        if "not found" in listed:
            raise HilError(f"{source} lacks a library:\n{listed}")
        for library in re.findall(r"(/\S+) \(0x", listed):
            if os.path.dirname(library) in LIBRARY_FOLDERS:
                self.add_file(library, library, 0o755)
            else:
                self.add_elsewhere(library)
                self.add_link(f"/usr/lib/{os.path.basename(library)}", f"/add{library}")

    def add_elsewhere(self, source):
        """A file of a person's own, below /add, as the guest mounts over /tmp and others.

        It stands to its neighbours as it does here, for programs that look beside themselves.
        """
        inside = f"/add{source}"
        if not self.path(inside).exists():
            self.add_file(source, inside)
        return inside

    def add_own(self, source):
        """What somebody has asked for: a program, library, script or file, or a folder of them.

        Programs are found by their names; the rest is below /add.
        """
        source = pathlib.Path(os.path.abspath(source))
        if not source.exists():
            raise HilError(f"--add {source}: no such file; name a program, a library or a folder")
        files = [source] if source.is_file() else [f for f in sorted(source.rglob("*")) if f.is_file()]
        if not files:
            raise HilError(f"--add {source}: nothing in it that can be added")
        for file in files:
            inside = self.add_elsewhere(file)
            self.add_libraries(file)
            if re.search(r"\.so(\.|$)", file.name):
                self.add_link(f"/usr/lib/{file.name}", inside)
            elif os.access(file, os.X_OK):
                self.add_link(f"/usr/bin/{file.name}", inside)

    def pack(self, file):
        names = [str(path.relative_to(self.folder)) for path in sorted(self.folder.rglob("*"))]
        try:
            with open(file, "wb") as archive:  # not compressed: the guest would have to undo it
                subprocess.run(
                    ["cpio", "--quiet", "-o", "-H", "newc", "-R", "0:0"], cwd=self.folder,
                    input="\n".join(names).encode(), stdout=archive, stderr=subprocess.PIPE,
                    check=True)
        except (FileNotFoundError, subprocess.CalledProcessError) as error:
            raise HilError(f"cpio: {error}; `make setup` installs it") from error


def tool(name):
    """busybox-static has the very name of busybox, usbip may live in sbin."""
    path = shutil.which(name, path=os.environ.get("PATH", "") + ":/usr/sbin:/sbin")
    if path is None:
        raise HilError(f"{name} is not installed; `make setup` installs it")
    return path


class Session:
    """What --shell or --run asks for."""

    def __init__(self, arguments):
        self.command = arguments.run
        self.devices = arguments.device or ["woodenhaptics_v2015"]
        self.emulator_flags = arguments.emulator_flags
        self.added = arguments.add

    def put_into(self, root):
        names = []
        for device in self.devices:
            file = pathlib.Path(device)
            if (ROOT / "profiles" / f"{device}.toml").is_file():
                names.append(device)
            elif file.is_file():
                root.add_file(file, f"/root/{file.name}", 0o644)
                names.append(f"/root/{file.name}")
            else:
                known = ", ".join(sorted(file.stem for file in (ROOT / "profiles").glob("*.toml")))
                raise HilError(f"--device {device}: neither a file nor one of: {known}")
        for added in self.added:
            root.add_own(added)
        root.add_text("/hil/devices", " ".join(names) + "\n")
        root.add_text("/hil/emulator_flags", self.emulator_flags + "\n")
        root.add_text("/hil/shell", "")
        if self.command:
            root.add_text("/hil/run", self.command + "\n")
