#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes a wheel of the built package: a zip of its files, the profiles and a dist-info folder.
usage: make_wheel.py PACKAGE_FOLDER PROFILE_FOLDER LICENCE VERSION OUT_FOLDER
Prints the wheel's name. The same files give the same bytes."""
import base64
import hashlib
import pathlib
import stat
import sys
import sysconfig
import zipfile

METADATA = """Metadata-Version: 2.1
Name: forcegrid
Version: {version}
Summary: Feel soft virtual objects through a haptic arm
License: Apache-2.0
Requires-Python: =={python}.*
Requires-Dist: numpy>=1.24
Classifier: Operating System :: POSIX :: Linux
Classifier: Typing :: Typed
"""
WHEEL = """Wheel-Version: 1.0
Generator: forcegrid make_wheel.py
Root-Is-Purelib: false
Tag: {tag}
"""
EARLIEST = (1980, 1, 1, 0, 0, 0)  # that a zip can hold


def contents(package, profiles, licence, version, tag):
    """{name in the wheel: bytes}"""
    files = {"forcegrid/" + file.name: file.read_bytes() for file in sorted(package.iterdir())
             if file.suffix in (".py", ".pyi", ".so") or file.name == "py.typed"}
    files |= {"forcegrid/share/profiles/" + file.name: file.read_bytes()
              for file in sorted(profiles.glob("*.toml"))}
    info = f"forcegrid-{version}.dist-info/"
    python = "%d.%d" % sys.version_info[:2]
    files[info + "LICENSE"] = licence.read_bytes()
    files[info + "METADATA"] = METADATA.format(version=version, python=python).encode()
    files[info + "WHEEL"] = WHEEL.format(tag=tag).encode()
    record = ""
    for name, data in files.items():
        digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
        record += f"{name},sha256={digest},{len(data)}\n"
    files[info + "RECORD"] = (record + info + "RECORD,,\n").encode()
    return files


def main():
    package, profiles, licence = map(pathlib.Path, sys.argv[1:4])
    version, out = sys.argv[4], pathlib.Path(sys.argv[5])
    python = "cp%d%d" % sys.version_info[:2]
    platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
    tag = f"{python}-{python}-{platform}"
    files = contents(package, profiles, licence, version, tag)
    if not any(name.endswith(".so") for name in files):
        sys.exit(f"make_wheel.py: {package} has no compiled module; build forcegrid_python first")
    out.mkdir(parents=True, exist_ok=True)
    wheel = out / f"forcegrid-{version}-{tag}.whl"
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            entry = zipfile.ZipInfo(name, EARLIEST)
            mode = 0o755 if name.endswith(".so") else 0o644
            entry.external_attr = (stat.S_IFREG | mode) << 16
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, data)
    print(wheel)


if __name__ == "__main__":
    main()
