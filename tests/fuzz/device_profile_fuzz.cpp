// SPDX-License-Identifier: Apache-2.0
#include <sys/mman.h>
#include <unistd.h>

#include <string>

#include "driver/kinematics.h"
#include "profiles/device_profile.h"
#include "tests/fuzz/fuzz_targets.h"

namespace forcegrid::fuzz {

void device_profile(Input input) {
  static const int file = ::memfd_create("profile.toml", 0);
  require(file >= 0, "this system has memfd_create");
  require(::ftruncate(file, 0) == 0 &&
              ::pwrite(file, input.data(), input.size(), 0) == static_cast<ssize_t>(input.size()),
          "the file takes its bytes");
  try {
    const profiles::DeviceProfile profile =
        profiles::load_device_profile("/proc/self/fd/" + std::to_string(file));
    require(profile.limits.max_force_N > 0.0, "an accepted profile limits the force");
  } catch (const profiles::ProfileError&) {
    // A file that is refused is what most inputs are.
  }
}

}  // namespace forcegrid::fuzz
