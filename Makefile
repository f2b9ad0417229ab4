# The two commands: `make run` feels a soft block through an emulated arm; `make test` runs every
# test. Both install what is missing first (Debian 12, root or sudo).

DEVICE  ?= woodenhaptics_v2015
SCENE   ?= block
SECONDS ?= 20
ARGS    ?=

PROGRAM := build/release/bin/forcegrid
STAMP   := build/.packages

# A device that is attached is named as the program names it (hid:... or usbip:...); a bare profile
# name means the emulated one.
DEVICE_URL = $(if $(findstring :,$(DEVICE)),$(DEVICE),emulated:$(DEVICE))

.PHONY: run test build setup bench sanitize clean

run: build
	$(PROGRAM) run --device $(DEVICE_URL) --scene $(SCENE) --seconds $(SECONDS) $(ARGS)

test: build
	ctest --test-dir build/release -j2 --output-on-failure

bench: build
	build/release/bin/forcegrid_bench

# The tests again under AddressSanitizer with UndefinedBehaviorSanitizer, and ThreadSanitizer.
sanitize: setup
	for preset in asan tsan; do \
	  cmake --preset $$preset >/dev/null && cmake --build --preset $$preset && \
	  ctest --test-dir build/$$preset -j2 --output-on-failure || exit 1; \
	done

build: setup build/release/build.ninja
	cmake --build --preset release

build/release/build.ninja: CMakePresets.json
	cmake --preset release

setup: $(STAMP)

$(STAMP): setup/packages.txt setup/install.sh
	setup/install.sh
	@mkdir -p build && touch $@

clean:
	rm -rf build out
