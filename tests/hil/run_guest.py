#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs the hardware-in-the-loop scenarios in a virtual machine with a stock Debian kernel.

With --shell or --run: a shell, or a command, in the same guest with emulated devices attached, and
with whatever programs --add puts into it.

The guest is an initramfs made of this machine's busybox, udev, usbip and lsusb, the project's program,
the scenario program and the libraries they need; the kernel is Debian's, fetched by apt and unpacked,
never installed. A scenario counts as passed only when the guest says so in so many words: a scenario
without a result, or a guest that does not come to its end, is a failure.

Exit status: 0 all passed; 1 a scenario failed or has no result; 2 the guest could not be made or run.
"""

import argparse
import concurrent.futures
import contextlib
import fcntl
import json
import os
import pathlib
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time

from guest_files import HilError, Initramfs, Session, output_of, tool

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
MODULES = ["vhci-hcd", "usbhid", "hid-generic", "uhid", "ftdi_sio", "veth", "sch_netem"]
TOOLS = ["busybox", "udevadm", "usbip", "lsusb", "cyclictest", "usermod", "ip", "tc",
         "ftdi_eeprom"]
CLIENTS = ["hil_client_hidraw", "hil_client_libusb"]  # beside the scenario program
TIMING_SUITES = ("LongTiming.", "PreemptRtTiming.")
TIMING_TOOLS = ["stress-ng"]  # large, so only where they are used
TIMING_PROGRAMS = ["forcegrid_null_loop", "forcegrid_driver_loop", "forcegrid_hd_spring",
                   "forcegrid-view"]  # beside the program
# What the live view serves besides its own page, from libjs-three and libjs-dygraphs.
VIEW_LIBRARIES = ["three/three.module.js", "three/examples/jsm/controls/OrbitControls.js",
                  "dygraphs/dygraph.js", "dygraphs/dygraph.css"]
TOOLS_PROGRAM = "forcegrid-tools"  # beside the program, which becomes it for its commands
LONG_SUITE = "Long"  # left out of the smoke set: suites that begin so
# What glibc converts character sets with; hidapi's libusb back end reads USB strings by it.
GCONV = ["gconv-modules", "gconv-modules.d/gconv-modules-extra.conf", "UTF-16.so"]
RT_SUITE = "PreemptRt"  # only on a PREEMPT_RT kernel
# In gnuplot's place: each picture is what it is known to be whole by, the end of a PNG and of an SVG.
DRAWS_NOTHING = """#!/bin/sh
sed -n "s/^set output '\\(.*\\)'.*/\\1/p" | while read -r file; do
  printf '%64s' 'IEND </svg>' >"$file"
done
"""
MADE_TO_FAIL = "MadeToFail."  # only run when named
# A kernel that has met one of its own faults may go on, but nothing after it can be trusted.
KERNEL_FAULT = re.compile(r"\b(?:kernel BUG at|BUG:|Oops:|general protection fault).*")


# --- the kernel ---


class Kernel:
    """An unpacked kernel package: boot/vmlinuz-VERSION and lib/modules/VERSION."""

    def __init__(self, folder):
        self.folder = folder
        self.version = next((folder / "lib/modules").iterdir()).name

    @property
    def image(self):
        return self.folder / "boot" / f"vmlinuz-{self.version}"

    def modules(self):
        """Files of MODULES and of what these need, in the order of loading."""
        files = []
        for module in MODULES:
            text = output_of(["modprobe", "-d", self.folder, "-S", self.version, "--show-depends",
                              module])
            for line in text.splitlines():
                words = line.split()
                if words[:1] == ["insmod"] and words[1] not in files:
                    files.append(words[1])
        return files


def apt_options(private):
    """Options for apt with package lists of our own, which needs no root."""
    if private is None:
        return []
    for folder in ("lists/partial", "cache/archives/partial"):
        (private / folder).mkdir(parents=True, exist_ok=True)
    return ["-o", f"Dir::State::Lists={private}/lists", "-o", f"Dir::Cache={private}/cache"]


def versioned_package(metapackage, options):
    """The kernel package behind a metapackage, and its version."""
    text = output_of(["apt-cache", *options, "show", "--no-all-versions", metapackage])
    match = re.search(r"^Depends:.*?\b(linux-image-\d[^\s,]*)", text, re.MULTILINE)
    if not match:
        raise HilError(f"package {metapackage} names no kernel package")
    package = match.group(1)
    text = output_of(["apt-cache", *options, "show", "--no-all-versions", package])
    match = re.search(r"^Version: (\S+)", text, re.MULTILINE)
    if not match:
        raise HilError(f"package {package} has no version")
    return package, match.group(1)


def unpack(package_file, folder):
    """Unpacks kernel and modules into `folder`, which appears whole or not at all."""
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix="unpacking-") as temporary:
        target = pathlib.Path(temporary) / "kernel"
        target.mkdir()
        output_of(["dpkg", "-x", package_file, target])
        (version,) = [entry.name for entry in (target / "lib/modules").iterdir()]
        output_of(["depmod", "-b", target, version])
        target.rename(folder)


def fetch_kernel(cache, metapackage):
    """The newest kernel that apt knows, or the newest in the cache when apt can't say."""
    kernels = cache / "kernels"
    kernels.mkdir(parents=True, exist_ok=True)
    problems = []
    for private in (None, cache / "apt"):
        try:
            options = apt_options(private)
            if private is not None:
                output_of(["apt-get", *options, "update", "-q"])
            package, version = versioned_package(metapackage, options)
            folder = kernels / f"{metapackage}_{version}"
            if not folder.exists():
                print(f"Fetching {package} {version} into {folder}", flush=True)
                with tempfile.TemporaryDirectory(dir=cache, prefix="download-") as download:
                    output_of(["apt-get", *options, "download", "-q", f"{package}={version}"],
                              cwd=download)
                    (file,) = pathlib.Path(download).glob("*.deb")
                    unpack(file, folder)
                for old in kernels.glob(f"{metapackage}_*"):
                    if old != folder:
                        shutil.rmtree(old)
            return Kernel(folder)
        except HilError as error:
            problems.append(str(error))
    cached = sorted(kernels.glob(f"{metapackage}_*"), key=lambda entry: entry.stat().st_mtime)
    if cached:
        print(f"apt does not answer ({problems[0]}); using {cached[-1].name} of the cache")
        return Kernel(cached[-1])
    raise HilError(
        f"the guest's kernel ({metapackage}) can't be fetched and is not in {kernels}:\n  "
        + "\n  ".join(problems)
        + "\nRemedy: give this machine access to a Debian mirror (`sudo apt-get update` must work), or "
        "fetch the package on another one (`apt-get download linux-image-...-amd64`, the versioned "
        "one) and name the file: FORCEGRID_HIL_KERNEL_DEB=FILE make hil")


def kernel_of(cache, metapackage):
    named = os.environ.get("FORCEGRID_HIL_KERNEL_DEB")
    cache.mkdir(parents=True, exist_ok=True)
    with open(cache / "lock", "w", encoding="ascii") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not named:
            return fetch_kernel(cache, metapackage)
        file = pathlib.Path(named).resolve()
        if not file.is_file():
            raise HilError(f"FORCEGRID_HIL_KERNEL_DEB={named}: no such file")
        folder = cache / "kernels" / f"file_{file.stem}"
        folder.parent.mkdir(parents=True, exist_ok=True)
        if not folder.exists():
            unpack(file, folder)
        return Kernel(folder)


# --- the guest's files ---


def run_session(session, command, folder, results, timeout_s):
    """Runs the guest for a person or for one command. @returns the shell's or command's status."""
    said = folder / "said"
    console = ["-serial", "mon:stdio"]
    stdin = None
    if session.command:
        console = ["-serial", "stdio"]
        stdin = subprocess.DEVNULL
    try:
        subprocess.run(command + console + ["-serial", f"file:{said}"], check=False, stdin=stdin,
                       timeout=timeout_s if session.command else None)
    except subprocess.TimeoutExpired as error:
        raise HilError(f"the guest did not end within {timeout_s} s and was stopped; give it more "
                       "with --timeout") from error
    text = said.read_text(encoding="utf-8", errors="replace") if said.exists() else ""
    status = re.search(r"^HIL-STATUS (\d+)\n", text, re.MULTILINE)
    if not status:
        raise HilError("the guest ended without a word of the status; its console is above")
    summary = text[status.end():]
    if summary.strip():
        (results / "emulator.json").write_text(summary, encoding="utf-8")
        print(f"What the emulated devices saw is in {results / 'emulator.json'}")
    return int(status.group(1)) if session.command else 0


def make_initramfs(file, kernel, program, scenarios, names, limit_s, session):
    with tempfile.TemporaryDirectory(dir=file.parent, prefix="root-") as temporary:
        root = Initramfs(pathlib.Path(temporary))
        for folder in ("proc", "sys", "dev", "tmp", "run", "root", "etc", "bin"):
            (root.folder / folder).mkdir(exist_ok=True)
        root.add_file(HERE / "guest/init", "init", 0o755)
        for name in TOOLS:
            root.add_program(tool(name), "/bin/busybox" if name == "busybox" else f"/usr/bin/{name}")
        root.add_program(tool("udevadm"), "/usr/lib/systemd/systemd-udevd")
        for rule in output_of(["dpkg", "-L", "udev"]).split():
            if rule.endswith(".rules"):
                root.add_file(rule, rule)
        root.add_file(ROOT / "udev/10-forcegrid.rules", "/etc/udev/rules.d/10-forcegrid.rules", 0o644)
        # "operator" is in plugdev, "visitor" in no group but its own.
        root.add_text("/etc/passwd", "root:x:0:0:root:/root:/bin/sh\n"
                      "operator:x:1000:1000::/tmp:/bin/sh\nvisitor:x:1001:1001::/tmp:/bin/sh\n")
        root.add_text("/etc/group", "root:x:0:\ntty:x:5:\ndisk:x:6:\nlp:x:7:\nkmem:x:15:\ndialout:x:20:\n"
                      "cdrom:x:24:\ntape:x:26:\naudio:x:29:\nvideo:x:44:\nplugdev:x:46:operator\n"
                      "sgx:x:101:\ninput:x:102:\nkvm:x:103:\nrender:x:104:\noperator:x:1000:\n"
                      "visitor:x:1001:\n")
        root.add_text("/etc/nsswitch.conf", "passwd: files\ngroup: files\nhosts: files\n")
        root.add_text("/etc/hosts", "127.0.0.1 localhost\n")
        # Root follows the advice that is given to people with sudo.
        root.add_text("/usr/bin/sudo", "#!/bin/sh\nexec \"$@\"\n", 0o755)
        root.add_text("/etc/security/limits.d/README", "As libpam-modules makes it.\n")
        # Pictures are no matter of this guest: each that would be drawn is empty but for its end.
        root.add_text("/usr/bin/gnuplot", DRAWS_NOTHING, 0o755)
        root.add_program(program, "/usr/bin/forcegrid")
        if not (program.parent / TOOLS_PROGRAM).is_file():
            raise HilError(f"{program.parent / TOOLS_PROGRAM} is not built; run `make tools`")
        root.add_program(program.parent / TOOLS_PROGRAM, f"/usr/bin/{TOOLS_PROGRAM}")
        root.add_program(scenarios, "/hil/scenarios")
        for client in CLIENTS:
            root.add_program(scenarios.parent / client, f"/usr/bin/{client}")
        if any(name.startswith(TIMING_SUITES) for name in names):
            for name in TIMING_TOOLS:
                root.add_program(tool(name), f"/usr/bin/{name}")
            for name in TIMING_PROGRAMS:
                if not (program.parent / name).is_file():
                    raise HilError(f"{program.parent / name} is not built; configure with "
                                   "-DFORCEGRID_BUILD_TESTS=ON, as `make test` does")
                root.add_program(program.parent / name, f"/usr/bin/{name}")
            for page in sorted((ROOT / "view/page").iterdir()):
                root.add_file(page, f"/usr/share/forcegrid/view/{page.name}", 0o644)
            for name in VIEW_LIBRARIES:
                library = pathlib.Path("/usr/share/javascript") / name
                if not library.is_file():
                    raise HilError(f"{library} is missing; `setup/install.sh view` installs it")
                root.add_file(library, library, 0o644)
        for profile in sorted((ROOT / "profiles").glob("*.toml")):
            root.add_file(profile, f"/usr/share/forcegrid/profiles/{profile.name}", 0o644)
        for scene in sorted((ROOT / "simulator/scenes").glob("*.toml")):
            root.add_file(scene, f"/usr/share/forcegrid/scenes/{scene.name}", 0o644)
        (gconv,) = {pathlib.Path(name).parent for name in output_of(["dpkg", "-L", "libc6"]).split()
                    if name.endswith("/gconv/UTF-16.so")}
        for name in GCONV:
            root.add_file(gconv / name, gconv / name)
        inside = []
        for module in kernel.modules():
            relative = "/" + str(pathlib.Path(module).relative_to(kernel.folder))
            root.add_file(module, relative, 0o644)
            inside.append(relative)
        root.add_text("/hil/modules", "".join(f"{module}\n" for module in inside))
        root.add_text("/hil/list", "".join(f"{name} {limit_s}\n" for name in names))
        if session:
            session.put_into(root)
        root.pack(file)


# --- running it ---


# How the guest's time passes. By instructions: one CPU, on which each instruction takes a nanosecond
# and idle time nothing, so that a busy machine makes the guest slow but never late, and what happens
# in it hardly differs from run to run; its CPU has no AVX, which QEMU emulates lane by lane (a
# quarter more of this machine's time). By the host's clock: two CPUs, and every pause of the host is
# a pause of the guest.
MACHINES = {
    "instructions": ["-accel", "tcg,thread=single", "-icount", "shift=0,sleep=off",
                     "-cpu", "Nehalem", "-smp", "1"],
    "host": ["-accel", "tcg,thread=multi", "-cpu", "max", "-smp", "2"],
    "kvm": ["-accel", "kvm", "-cpu", "host", "-smp", "2"],
}


def qemu_command(kernel, initramfs, machine, timing_s=10):
    return [
        tool("qemu-system-x86_64"), "-M", "q35", *MACHINES[machine], "-m", "768", "-display", "none",
        "-no-reboot", "-nic", "none", "-kernel", str(kernel.image), "-initrd", str(initramfs),
        # A guest that lives for minutes has no secrets; without the mitigations it takes a tenth less.
        # What the kernel does not know it hands on to the first process as an environment variable.
        "-append", f"console=ttyS0 panic=-1 loglevel=7 mitigations=off HIL_MACHINE={machine} "
        f"HIL_TIMING_SECONDS={timing_s}"
    ]


def machine_of(environment):
    accelerator, clock = environment.get("ACCEL", "tcg"), environment.get("CLOCK", "instructions")
    if accelerator not in ("tcg", "kvm"):
        raise HilError(f"ACCEL={accelerator}: it is tcg (the default) or kvm")
    if clock not in ("instructions", "host"):
        raise HilError(f"CLOCK={clock}: it is instructions (the default) or host")
    return "kvm" if accelerator == "kvm" else clock


def all_scenarios(program):
    """The names in a GoogleTest program, as Suite.Test."""
    names, suite = [], ""
    for line in output_of([program, "--gtest_list_tests"]).splitlines():
        if line and not line.startswith(" "):
            suite = line.split()[0] if line.split()[0].endswith(".") else ""
        elif suite:
            names.append(suite + line.split()[0])
    return names


def chosen(names, wanted, only, metapackage):
    if only:
        missing = [name for name in only if name not in names]
        if missing:
            raise HilError(f"no scenario {', '.join(missing)}; there are:\n  " + "\n  ".join(names))
        return only
    names = [name for name in names if not name.startswith(MADE_TO_FAIL)]
    if "-rt-" not in metapackage:
        names = [name for name in names if not name.startswith(RT_SUITE)]
    if wanted == "smoke":
        names = [name for name in names if not name.startswith(LONG_SUITE)]
    return names


def read_results(text, names):
    """What the guest said about each scenario.

    @returns results by name, and whether the guest came to its end.
    """
    results = {name: {"status": "missing", "measured": {}, "devices": [], "hosts": [], "log": ""}
               for name in names}
    current = None
    for line in text.splitlines():
        words = line.split()
        if words[:1] == ["HIL-BEGIN"] and len(words) == 3 and words[1] in results:
            current = words[1]
            results[current].update(status="unfinished", begun_s=float(words[2]))
        elif words[:1] == ["HIL-END"] and len(words) == 4 and words[1] == current:
            code = int(words[2])
            results[current].update(
                status="passed" if code == 0 else "timed out" if code in (137, 143) else "failed",
                exit_status=code, seconds=round(float(words[3]) - results[current]["begun_s"], 2))
            current = None
        elif words[:1] == ["HIL-MEASURED"] and len(words) == 4 and current:
            results[current]["measured"][words[1]] = {"value": float(words[2]), "unit": words[3]}
        elif words[:1] in (["HIL-DEVICE"], ["HIL-HOST"]) and len(words) == 2 and current:
            covered = results[current]["devices" if words[0] == "HIL-DEVICE" else "hosts"]
            if words[1] not in covered:
                covered.append(words[1])
        elif current:
            results[current]["log"] += line + "\n"
    ended = any(line.startswith("HIL-DONE") for line in text.splitlines()[-3:])
    return results, ended


def run_scenarios(command, folder, names, timeout_s):
    console, said = folder / "console.log", folder / "scenarios.log"
    command = command + ["-serial", f"file:{console}", "-serial", f"file:{said}"]
    begun = time.monotonic()
    with open(folder / "qemu.log", "w", encoding="utf-8") as log:
        with contextlib.closing(Guest(command, log)) as guest:
            in_time = guest.wait(timeout_s)
            qemu_status = guest.status()
    seconds = time.monotonic() - begun
    text = said.read_text(encoding="utf-8", errors="replace") if said.exists() else ""
    results, ended = read_results(text, names)
    problem = ""
    if not in_time:
        problem = f"the guest did not end within {timeout_s} s and was stopped"
    elif not ended:
        problem = f"the guest stopped before its end (QEMU's exit status was {qemu_status})"
    kernel_said = console.read_text(encoding="utf-8", errors="replace") if console.exists() else ""
    kernel_fault = KERNEL_FAULT.search(kernel_said)
    if kernel_fault:
        problem = f"the guest's kernel reported a fault of its own: {kernel_fault.group().strip()}"
    kernel = re.search(r"^HIL-KERNEL (.*)$", text, re.MULTILINE)
    return {
        "kernel": kernel.group(1) if kernel else "",
        "wall_seconds": round(seconds, 1),
        "guest_ended": in_time and ended,
        "problem": problem,
        "scenarios": results,
    }


def joined(outcomes, names, folders, folder):
    """One outcome of guests that shared the scenarios, and their logs one after the other."""
    scenarios = {name: result for outcome in outcomes
                 for name, result in outcome["scenarios"].items()}
    for log in ("console.log", "scenarios.log", "qemu.log"):
        with open(folder / log, "wb") as whole:
            for part in folders:
                if (part / log).exists():
                    whole.write((part / log).read_bytes())
    return {
        "kernel": next((o["kernel"] for o in outcomes if o["kernel"]), ""),
        "wall_seconds": max(o["wall_seconds"] for o in outcomes),
        "guest_ended": all(o["guest_ended"] for o in outcomes),
        "problem": next((o["problem"] for o in outcomes if o["problem"]), ""),
        "scenarios": {name: scenarios[name] for name in names},
    }


def shares_of(names, guests):
    """The scenarios dealt out like cards."""
    return [share for share in (names[i::guests] for i in range(guests)) if share]


class Guest:
    """A running QEMU, which does not outlive its with block."""

    def __init__(self, command, log):
        self.process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log)

    def wait(self, timeout_s):
        try:
            self.process.wait(timeout_s)
            return True
        except subprocess.TimeoutExpired:
            return False

    def status(self):
        return self.process.poll()

    def close(self):
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()


def keep_results(outcome, run_folder, folder, whole_set):
    """Puts the results of a run into `folder`, whole: several runs may go on at once.

    Those of a whole set are also kept by set and kernel, for the matrix and the table of timings.
    """
    text = json.dumps(outcome, indent=2) + "\n"
    names = ["results.json", "scenarios.log", "console.log", "qemu.log"]
    (run_folder / "results.json").write_text(text, encoding="utf-8")
    if whole_set:
        names.append(f"set_{outcome['set']}_{outcome['metapackage']}.json")
        (run_folder / names[-1]).write_text(text, encoding="utf-8")
    for name in names:
        if (run_folder / name).exists():
            os.replace(run_folder / name, folder / name)


TIMING = TIMING_SUITES[0] + "OfTheServoLoopBesideCyclictest"
TIMING_ROWS = [("wake-up, cyclictest", "cyclictest_wakeup"), ("wake-up, servo loop", "servo_wakeup"),
               ("period, servo loop", "servo_period")]
PARTS = ["p50", "p99", "p999", "max"]


def timing_of(outcome):
    """[us] by row and part; nothing where the scenario did not run or failed."""
    scenario = outcome["scenarios"].get(TIMING, {})
    if scenario.get("status") != "passed":
        return None
    return {title: [scenario["measured"][f"{name}_{part}"]["value"] for part in PARTS]
            for title, name in TIMING_ROWS}


def keep_timing(outcome, folder):
    """Adds this boot to the table of timings, one boot for each kernel, and prints its line."""
    timing = timing_of(outcome)
    if timing is None:
        return
    file = folder / "timing.json"
    kernels = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    kernels[outcome["metapackage"]] = {"kernel": outcome["kernel"], "date": outcome["date"],
                                       "machine": outcome["machine"], "us": timing}
    lines = ["Wake-up latency and period at 500 Hz in microseconds."]
    for kernel in kernels.values():
        lines += ["", f"{kernel['kernel']}, {kernel['date']}, time by {kernel['machine']}",
                  f"  {'':22}" + "".join(f"{part:>10}" for part in PARTS)]
        lines += [f"  {title:22}" + "".join(f"{value:10.0f}" for value in values)
                  for title, values in kernel["us"].items()]
    file.write_text(json.dumps(kernels, indent=2) + "\n", encoding="utf-8")
    (folder / "timing.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    wakeup, servo, period = timing.values()
    print(f"Timing ({outcome['kernel'].split()[0]}): wake-up p50/p99/max cyclictest "
          f"{wakeup[0]:.0f}/{wakeup[1]:.0f}/{wakeup[3]:.0f} us, servo loop "
          f"{servo[0]:.0f}/{servo[1]:.0f}/{servo[3]:.0f} us; period p50/p99/max "
          f"{period[0]:.0f}/{period[1]:.0f}/{period[3]:.0f} us; {folder / 'timing.txt'}")


def print_results(outcome, folder):
    print(f"Guest: Linux {outcome['kernel'] or '(no word from it)'}")
    for name, result in outcome["scenarios"].items():
        print(f"  {result['status']:>10}  {result.get('seconds', 0):6.1f} s  {name}")
        for what, measure in result["measured"].items():
            print(f"{'':24}{what} = {measure['value']:g} {measure['unit']}")
        if result["status"] != "passed":
            print("".join(f"      | {line}\n" for line in result["log"].splitlines()), end="")
    if outcome["problem"]:
        print(f"FAILED: {outcome['problem']}; the end of its console:")
        console = folder / "console.log"
        if console.exists():
            text = console.read_text(encoding="utf-8", errors="replace")
            print("".join(f"      | {line}\n" for line in text.splitlines()[-15:]), end="")
        log = (folder / "qemu.log").read_text(encoding="utf-8", errors="replace").strip()
        print(f"      | QEMU: {log}" if log else "", end="\n" if log else "")
    passed = sum(result["status"] == "passed" for result in outcome["scenarios"].values())
    in_guest_s = sum(result.get("seconds", 0) for result in outcome["scenarios"].values())
    print(f"{passed} of {len(outcome['scenarios'])} scenarios passed in "
          f"{outcome['wall_seconds']} s; they took {in_guest_s:.0f} s of the guests' time and "
          f"{outcome['processor_seconds']} s of this machine's processors")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    build = ROOT / "build/release"
    parser.add_argument("--program", type=pathlib.Path, default=build / "bin/forcegrid")
    parser.add_argument("--scenarios", type=pathlib.Path, default=build / "tests/hil_scenarios")
    parser.add_argument("--cache", type=pathlib.Path, default=ROOT / "build/hil",
                        help="folder of the unpacked kernels")
    parser.add_argument("--results", type=pathlib.Path, help="folder of logs (default CACHE/results)")
    parser.add_argument("--kernel", default="linux-image-amd64", help="metapackage of the kernel")
    parser.add_argument("--set", choices=["smoke", "full"], default="smoke")
    parser.add_argument("--only", action="append", metavar="SUITE.TEST", help="just these")
    parser.add_argument("--limit", type=int, default=240, help="seconds for one scenario")
    parser.add_argument("--timeout", type=int, default=700, help="seconds for the guests")
    parser.add_argument("--timing-seconds", type=int, default=10, metavar="S",
                        help="of each run that is compared with another (a third with a live view); "
                        "give --limit more than 21 times that")
    parser.add_argument("--guests", type=int, default=2,
                        help="guests that share the scenarios, where their time is their own")
    parser.add_argument("--shell", action="store_true",
                        help="a shell with emulated devices attached, in place of the scenarios")
    parser.add_argument("--run", metavar="COMMAND", help="the same for one command of the shell, whose "
                        "status becomes this program's")
    parser.add_argument("--device", nargs="+", metavar="PROFILE",
                        help="profiles of those devices, by name or file (woodenhaptics_v2015)")
    parser.add_argument("--emulator-flags", default="", metavar="FLAGS",
                        help="more flags of 'forcegrid emulate', as --emulator-flags=--calibrated")
    parser.add_argument("--add", nargs="+", default=[], metavar="PATH",
                        help="programs with their libraries, other files and folders for the guest")
    arguments = parser.parse_args()
    session = Session(arguments) if arguments.shell or arguments.run else None
    if not session and (arguments.add or arguments.device or arguments.emulator_flags):
        parser.error("--device, --emulator-flags and --add go with --shell or --run")
    # An exception, so that the guest ends with its runner.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        machine = machine_of(os.environ)
        clients = [arguments.scenarios.parent / client for client in CLIENTS]
        for program in (arguments.program, arguments.scenarios, *clients):
            if not program.is_file():
                raise HilError(f"{program} is not built; run `make build`")
        results = arguments.results or arguments.cache / "results"
        results.mkdir(parents=True, exist_ok=True)
        names = chosen(all_scenarios(arguments.scenarios), arguments.set, arguments.only,
                       arguments.kernel)
        kernel = kernel_of(arguments.cache, arguments.kernel)
        with tempfile.TemporaryDirectory(dir=results, prefix="guest-") as temporary:
            temporary = pathlib.Path(temporary)

            def command_for(folder, share):
                folder.mkdir(exist_ok=True)
                make_initramfs(folder / "initramfs", kernel, arguments.program,
                               arguments.scenarios, share, arguments.limit, session)
                return qemu_command(kernel, folder / "initramfs", machine,
                                    arguments.timing_seconds)

            if session:
                if not session.command and machine == "instructions":
                    machine = "host"  # as is a person's time
                return run_session(session, command_for(temporary, names), temporary, results,
                                   arguments.timeout)
            shares = shares_of(names, arguments.guests if machine == "instructions" else 1)
            folders = [temporary / f"guest-{i}" for i in range(len(shares))]
            commands = list(map(command_for, folders, shares))
            with concurrent.futures.ThreadPoolExecutor(len(shares)) as pool:
                outcomes = list(pool.map(run_scenarios, commands, folders, shares,
                                         [arguments.timeout] * len(shares)))
            outcome = joined(outcomes, names, folders, temporary)
            used = resource.getrusage(resource.RUSAGE_CHILDREN)
            outcome.update(set=arguments.set, metapackage=arguments.kernel, machine=machine,
                           date=time.strftime("%Y-%m-%d"),
                           processor_seconds=round(used.ru_utime + used.ru_stime, 1))
            print_results(outcome, temporary)
            keep_results(outcome, temporary, results, not arguments.only)
            keep_timing(outcome, results)
            print(f"Logs and results.json are in {results}")
    except HilError as error:
        print(f"hil: {error}", file=sys.stderr)
        return 2
    if outcome["problem"]:
        return 2
    return 0 if all(r["status"] == "passed" for r in outcome["scenarios"].values()) else 1


if __name__ == "__main__":
    sys.exit(main())
