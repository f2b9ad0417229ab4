# SPDX-License-Identifier: Apache-2.0
# The two commands: `make run` renders a soft block on an emulated arm; `make test` runs every test.
# Each first installs and builds what it needs (Debian 12, root or sudo), and nothing else.

DEVICE  ?= woodenhaptics_v2015
SCENE   ?= block
SIMULATOR ?=
WORKERS ?= 0
SECONDS ?= 20
ARGS    ?=
ADD     ?=
FUZZ_SECONDS ?= 600
SANITIZERS ?= asan tsan
SINCE   ?=
MINUTES ?= 0

PROGRAM := build/release/bin/forcegrid

# Groups of setup/packages.txt.
PACKAGES = $(addprefix build/.packages-,$(1))
FOR_PROGRAM := $(call PACKAGES,run)
FOR_TOOLS   := $(call PACKAGES,run chart)
FOR_VIEW    := $(call PACKAGES,run view)
FOR_TESTS   := $(call PACKAGES,run view mesh chart test fem browser python guest docs firmware)
FOR_DEB     := $(call PACKAGES,run view mesh chart python deb)
FOR_BENCH   := $(call PACKAGES,run chart test bench python guest)
CONFIGURE := setup/configure.sh
BUILD := cmake --build --preset release

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
HIL_SESSION = --device $(DEVICE) $(if $(ARGS),--emulator-flags='$(ARGS)') $(if $(ADD),--add $(ADD))
# Tests of the driver, or of the whole loop with a device, in user space.
USER_SPACE_TESTS := ^(W2\.|W3\.|UsbipTransport|EmulatorServer|MainJob|.*ReportAge|.*Falcon|.*Fault|.*Reconnect|.*Malformed)
UDEV_RULE := $(DESTDIR)/etc/udev/rules.d/10-forcegrid.rules
# Its name in version 0.1.
OLD_UDEV_RULE := $(DESTDIR)/etc/udev/rules.d/70-forcegrid.rules
AS_ROOT := $(if $(DESTDIR),,$(if $(filter-out 0,$(shell id -u)),sudo))

.NOTPARALLEL:
.PHONY: run view scenes program tools build test test-full setup bench bench-realtime sanitize fuzz lint docs pictures
.PHONY: build-report clean deb deb-test
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
# DEVICE=woodenhaptics_onboard: the force method METHOD=grid, rls or kriging on the arm's own processor,
# emulated, too (docs/firmware.md).
METHOD ?= rls
# Scenes whose meshes have to be made.
MADE_SCENE = $(if $(filter liver liver_fine,$(SCENE)),scenes)
RUN := $(PROGRAM) run --device $(DEVICE_URL) --seconds $(SECONDS)

ifeq ($(SIMULATOR),bullet)
run: $(FOR_TOOLS)
	$(CONFIGURE) EXAMPLES
	$(BUILD) --target forcegrid_cli bullet_simulator
	examples/run_with_simulator.sh "build/release/bin/bullet_simulator 127.0.0.1:0" $(RUN) $(ARGS)
else ifeq ($(DEVICE),woodenhaptics_onboard)
run: program firmware $(MADE_SCENE)
	examples/firmware/run_on_board.sh $(METHOD) $(SCENE) $(PROGRAM) run \
	  --device emulated:woodenhaptics_v2015 --seconds $(SECONDS) $(ARGS)
else
run: program $(MADE_SCENE)
	$(RUN) --scene $(SCENE) $(if $(filter-out 0,$(WORKERS)),--workers $(WORKERS)) $(ARGS)
endif

# The run in a browser, until it is stopped, or for SECONDS. The program prints the address.
view: VIEW_SECONDS = $(if $(filter file,$(origin SECONDS)),0,$(SECONDS))
view: $(FOR_VIEW) $(MADE_SCENE)
	$(CONFIGURE) VIEW
	$(BUILD) --target forcegrid_cli forcegrid_view
	$(PROGRAM) run --device $(DEVICE_URL) --scene $(SCENE) --view --seconds $(VIEW_SECONDS) $(ARGS)

# Live tests that fail while the machine stands still run again; the end names them.
test: build-tests
	ctest --test-dir build/release -j6 --output-on-failure
	@grep -aE '^(AGAIN:|[0-9]+/[0-9]+ Testing: )' build/release/Testing/Temporary/LastTest.log | \
	  grep -a -B1 '^AGAIN:' || true

# What takes up to half a minute each: the page and whole runs in a browser, other people's
# finite-element codes, the installed copy, Python's stubs and wheel, the site of the documents.
test-full: build-tests
	ctest --test-dir build/release -C Full -L '^full$$' -j2 --output-on-failure

bench: build-bench
	build/release/bin/forcegrid_bench
	/usr/bin/python3 bench/client_cycle.py
	PYTHONPATH=build/release/python /usr/bin/python3 bench/python_queries.py \
	  build/release/bin/forcegrid_python_queries

# The loop's wake-ups beside cyclictest, idle and under load: half an hour. ARGS=--quick: two minutes.
bench-realtime: build-bench
	/usr/bin/python3 bench/realtime.py $(ARGS)

# The tests under AddressSanitizer with UndefinedBehaviorSanitizer, and those with threads under
# ThreadSanitizer. SANITIZERS=asan: only that one.
sanitize: $(FOR_TESTS) scenes
	for preset in $(SANITIZERS); do \
	  cmake --preset $$preset >/dev/null && cmake --build --preset $$preset && \
	  ctest --test-dir build/$$preset -j2 --output-on-failure || exit 1; \
	done

# The drivers on a real kernel, in a virtual machine (docs/hil.md). KERNEL=rt: the PREEMPT_RT kernel;
# ACCEL=kvm: with KVM. SHELL=1: a shell in it instead, or COMMAND="...": one command, with the emulated
# devices DEVICE="PROFILE ...", which take the flags ARGS, and the programs, files and folders
# ADD="PATH ...".
hil: build-tests
ifneq ($(HIL_SHELL),)
	$(HIL) --shell $(HIL_SESSION)
else ifeq ($(origin COMMAND),command line)
	$(HIL) --run '$(subst ','\'',$(COMMAND))' $(HIL_SESSION)
else ifneq ($(KERNEL),)
	$(HIL) --timeout 1200
else
	ctest --test-dir build/release -C Full -L hil -V
endif

hil-full: build-tests
	ctest --test-dir build/release -C Full -R '^hil.runner$$' --output-on-failure
	$(HIL) --set full --timeout 3000

# Writes docs/hil_matrix.md, the coverage page, from the last complete runs of the guest (hil, hil-full,
# each kernel) and from a run of the tests that drive an emulated device without a kernel.
hil-matrix: build-tests
	@mkdir -p build/hil/results
	cmake --preset release -DFORCEGRID_TESTS_ONE_BY_ONE=ON >/dev/null && $(BUILD)
	ctest --test-dir build/release -LE hil -R '$(USER_SPACE_TESTS)' -j2 \
	  --output-junit $(CURDIR)/build/hil/results/user_space.xml || true
	cmake --preset release -DFORCEGRID_TESTS_ONE_BY_ONE=OFF >/dev/null && $(BUILD)
	python3 tests/hil/matrix.py --junit build/hil/results/user_space.xml

# All pages and the C++ interfaces as one site without a network: build/docs/site/index.html.
docs: $(call PACKAGES,docs)
	/usr/bin/python3 docs/site/make_site.py . build/docs

# docs/pictures/*.svg from the *.dot beside them.
pictures: $(call PACKAGES,docs)
	docs/pictures/draw.sh

# Lets the person at the computer, and the group plugdev, use the devices without root.
install-udev:
	$(AS_ROOT) install -D -m 644 udev/10-forcegrid.rules $(UDEV_RULE)
	$(AS_ROOT) rm -f $(OLD_UDEV_RULE)
	$(if $(DESTDIR),,$(AS_ROOT) udevadm control --reload)
	@echo "Now plug the device in again."

uninstall-udev:
	$(AS_ROOT) rm -f $(UDEV_RULE) $(OLD_UDEV_RULE)
	$(if $(DESTDIR),,$(AS_ROOT) udevadm control --reload)

# build/release/bin/forcegrid, for everything that a run needs.
program: $(FOR_PROGRAM)
	$(CONFIGURE)
	$(BUILD) --target forcegrid_cli

# build/scenes/*.msh, which Gmsh makes of the geometries in simulator/scenes.
scenes: $(call PACKAGES,mesh)
	simulator/scenes/make_meshes.sh build/scenes

# build/release/bin/forcegrid-tools: charts, tuning, calibration. `forcegrid chart` and the like call
# this if it is missing.
tools: $(FOR_TOOLS)
	$(CONFIGURE) TOOLS
	$(BUILD) --target forcegrid_cli forcegrid_tools_program forcegrid_reference

# Debian packages of what is built: build/deb/*.deb.
deb: $(FOR_DEB) scenes
	$(CONFIGURE) TOOLS VIEW BINDINGS PYTHON
	$(BUILD)
	packaging/make_deb.sh

# Installs them in a new, minimal Debian, uses, upgrades and removes them there. As root, with a network.
deb-test: deb
	tests/package/deb_test.sh

# Both, the libraries and the examples.
build: $(FOR_TOOLS) $(call PACKAGES,python)
	$(CONFIGURE) TOOLS EXAMPLES BINDINGS PYTHON
	$(BUILD)

.PHONY: build-tests build-bench
build-tests: $(FOR_TESTS) scenes
	$(CONFIGURE) TESTS PYTHON
	$(BUILD)
	$(MAKE) firmware-images

build-bench: $(FOR_BENCH)
	$(CONFIGURE) BENCH BINDINGS PYTHON
	$(BUILD)

# Processor time of the last compilation of each source, by folder, and the slowest.
build-report: $(call PACKAGES,report)
	@python3 setup/build_report.py build/release

# The methods on a device's own processor (docs/firmware.md): build/firmware/*.elf, and what they take
# of its memory.
.PHONY: firmware firmware-images
firmware: $(call PACKAGES,run firmware) firmware-images
	@/usr/bin/python3 firmware/sizes.py build/firmware

firmware-images:
	@test -f build/firmware/build.ninja || cmake --preset firmware >/dev/null
	cmake --build --preset firmware

# All packages.
setup: $(call PACKAGES,$(shell sed -n 's/^\[\(.*\)\]$$/\1/p' setup/packages.txt))

build/.packages-%: setup/packages.txt setup/install.sh
	setup/install.sh $*
	@mkdir -p build && touch $@

# The unit tests of eight rooms under AddressSanitizer and UndefinedBehaviorSanitizer, as CI runs them:
# all that a byte from outside or a servo cycle goes through. `sanitize` is the whole.
.PHONY: sanitize-unit
sanitize-unit: $(FOR_TESTS) scenes
	cmake --preset asan-unit >/dev/null && cmake --build --preset asan-unit
	ctest --test-dir build/asan-unit -L unit -j2 --output-on-failure

# Fuzzes every parser of untrusted bytes, guided by coverage. New inputs go into build/fuzz/corpus,
# inputs that reveal a fault into build/fuzz/faults.
fuzz: $(FOR_TESTS) $(call PACKAGES,fuzz)
	cmake --preset fuzz >/dev/null && cmake --build --preset fuzz
	tests/fuzz/run_fuzzers.sh build/fuzz $(FUZZ_SECONDS)

# Format and code of every source (.clang-format, .clang-tidy). SINCE=REV: only what differs from REV;
# SINCE=last-merge: from the last merge's first parent. MINUTES=M: begins no source after that time.
# A source that was found clean is not checked again until it changes.
lint: $(FOR_BENCH) $(call PACKAGES,lint)
	cmake --preset lint >/dev/null
	setup/lint.py --minutes $(MINUTES) $(if $(SINCE),--since $(SINCE))

clean:
	rm -rf build out
