# SPDX-License-Identifier: Apache-2.0
# The two commands: `make run` renders a soft block on an emulated arm; `make test` runs every test.
# Both first install missing packages (Debian 12, root or sudo).

DEVICE  ?= woodenhaptics_v2015
SCENE   ?= block
SIMULATOR ?=
WORKERS ?= 0
SECONDS ?= 20
ARGS    ?=
FUZZ_SECONDS ?= 600
SANITIZERS ?= asan tsan
SINCE   ?=
MINUTES ?= 0

PROGRAM := build/release/bin/forcegrid
STAMP   := build/.packages

# DEVICE is a profile's name for the emulated device, or the program's name of an attached one
# (hid:... or usbip:...).
DEVICE_URL = $(if $(findstring :,$(DEVICE)),$(DEVICE),emulated:$(DEVICE))

# make would take SHELL=1 as the shell of its recipes.
ifeq ($(origin SHELL),command line)
HIL_SHELL := $(filter-out 0,$(SHELL))
override SHELL := /bin/sh
endif
ifneq ($(filter-out rt,$(KERNEL)),)
$(error KERNEL=$(KERNEL): it is rt, or left out for the stock kernel)
endif
HIL_KERNEL := linux-image-$(if $(filter rt,$(KERNEL)),rt-)amd64
HIL := python3 tests/hil/run_guest.py --kernel $(HIL_KERNEL)
# Tests of the driver, or of the whole loop with a device, in user space.
USER_SPACE_TESTS := ^(W2\.|W3\.|UsbipTransport|EmulatorServer|MainJob|.*ReportAge|.*Falcon|.*Fault|.*Reconnect|.*Malformed)
UDEV_RULE := $(DESTDIR)/etc/udev/rules.d/70-forcegrid.rules
AS_ROOT := $(if $(DESTDIR),,$(if $(filter-out 0,$(shell id -u)),sudo))

.PHONY: run test build setup bench bench-realtime sanitize fuzz lint docs pictures clean
.PHONY: hil hil-full hil-matrix install-udev uninstall-udev

# SIMULATOR=bullet: another simulator behind the link, examples/bullet_simulator.cpp.
ifneq ($(filter-out bullet,$(SIMULATOR)),)
$(error SIMULATOR=$(SIMULATOR): it is bullet, or left out for this project's own)
endif
ifneq ($(SIMULATOR),)
ifneq ($(filter command environment,$(firstword $(origin SCENE))),)
$(error SCENE=$(SCENE): SIMULATOR=$(SIMULATOR) has an object of its own; leave one of them out)
endif
ifneq ($(filter-out 0,$(WORKERS)),)
$(error WORKERS=$(WORKERS): only the project's own simulator has workers; leave SIMULATOR=$(SIMULATOR) out)
endif
endif
RUN := $(PROGRAM) run --device $(DEVICE_URL) --seconds $(SECONDS)

run: build
ifeq ($(SIMULATOR),bullet)
	examples/run_with_simulator.sh "build/release/bin/bullet_simulator 127.0.0.1:0" $(RUN) $(ARGS)
else
	$(RUN) --scene $(SCENE) $(if $(filter-out 0,$(WORKERS)),--workers $(WORKERS)) $(ARGS)
endif

# Live tests that fail while the machine stands still run again; the end names them.
test: build
	ctest --test-dir build/release -j2 --output-on-failure
	@grep -aE '^(AGAIN:|[0-9]+/[0-9]+ Testing: )' build/release/Testing/Temporary/LastTest.log | \
	  grep -a -B1 '^AGAIN:' || true

bench: build
	build/release/bin/forcegrid_bench

# The loop's wake-ups beside cyclictest, idle and under load: half an hour. ARGS=--quick: two minutes.
bench-realtime: build
	/usr/bin/python3 bench/realtime.py $(ARGS)

# The tests under AddressSanitizer with UndefinedBehaviorSanitizer, and those with threads under
# ThreadSanitizer. SANITIZERS=asan: only that one.
sanitize: setup
	for preset in $(SANITIZERS); do \
	  cmake --preset $$preset >/dev/null && cmake --build --preset $$preset && \
	  ctest --test-dir build/$$preset -j2 --output-on-failure || exit 1; \
	done

# The drivers on a real kernel, in a virtual machine (docs/hil.md). SHELL=1: a shell in it instead;
# KERNEL=rt: the PREEMPT_RT kernel; ACCEL=kvm: with KVM.
hil: build
ifneq ($(HIL_SHELL),)
	$(HIL) --shell
else ifneq ($(KERNEL),)
	$(HIL) --timeout 1200
else
	ctest --test-dir build/release -L hil -V
endif

hil-full: build
	$(HIL) --set full --timeout 3000

# Writes docs/hil_matrix.md, the coverage page, from the last complete runs of the guest (hil, hil-full,
# each kernel) and from a run of the tests that drive an emulated device without a kernel.
hil-matrix: build
	@mkdir -p build/hil/results
	ctest --test-dir build/release -LE hil -R '$(USER_SPACE_TESTS)' -j2 \
	  --output-junit $(CURDIR)/build/hil/results/user_space.xml || true
	python3 tests/hil/matrix.py --junit build/hil/results/user_space.xml

# All pages and the C++ interfaces as one site without a network: build/docs/site/index.html.
docs: setup
	/usr/bin/python3 docs/site/make_site.py . build/docs

# docs/pictures/*.svg from the *.dot beside them.
pictures: setup
	docs/pictures/draw.sh

# Lets the person at the computer, and the group plugdev, use the devices without root.
install-udev:
	$(AS_ROOT) install -D -m 644 udev/70-forcegrid.rules $(UDEV_RULE)
	$(if $(DESTDIR),,$(AS_ROOT) udevadm control --reload)
	@echo "Now plug the device in again."

uninstall-udev:
	$(AS_ROOT) rm -f $(UDEV_RULE)
	$(if $(DESTDIR),,$(AS_ROOT) udevadm control --reload)

build: setup build/release/build.ninja
	cmake --build --preset release

build/release/build.ninja: CMakePresets.json
	cmake --preset release

setup: $(STAMP)

$(STAMP): setup/packages.txt setup/install.sh
	setup/install.sh
	@mkdir -p build && touch $@

# Fuzzes every parser of untrusted bytes, guided by coverage. New inputs go into build/fuzz/corpus,
# inputs that reveal a fault into build/fuzz/faults.
fuzz: setup
	cmake --preset fuzz >/dev/null && cmake --build --preset fuzz
	tests/fuzz/run_fuzzers.sh build/fuzz $(FUZZ_SECONDS)

# Format and code of every source (.clang-format, .clang-tidy). SINCE=REV: only what differs from REV;
# SINCE=last-merge: from the last merge's first parent. MINUTES=M: begins no source after that time.
# A source that was found clean is not checked again until it changes.
lint: setup build/release/build.ninja
	setup/lint.py --minutes $(MINUTES) $(if $(SINCE),--since $(SINCE))

clean:
	rm -rf build out
