// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/hil/hil_bench.h"
#include "tests/support/program.h"

namespace forcegrid::hil {

/// Of the emulator: a Falcon whose firmware runs and whose axes are homed from the start.
extern const std::vector<std::string> kHomed;

/// The USB port of the attached Falcon as sysfs names it, e.g. "3-1"; empty without one.
std::string port_of_falcon();

/// An emulated Falcon in a process of its own, attached to this kernel by a USB/IP cable.
/// Everything ends with the object.
class FalconBench {
 public:
  explicit FalconBench(const std::vector<std::string>& emulator_arguments = {});
  ~FalconBench();
  FalconBench(const FalconBench&) = delete;
  FalconBench& operator=(const FalconBench&) = delete;

  const std::string& port() const { return port_; }

  /// Pulls the cable, and waits until the kernel knows.
  void unplug();
  /// Plugs it in, and waits until kernel and udev are done.
  void plug_in();

  /// Ends the emulator. @returns its report.
  nlohmann::json end();

 private:
  std::string report_file_;
  Program emulator_;
  std::string port_;
};

/// `forcegrid run` on libusb, to its end.
EndedRun run_falcon(const std::string& url, double duration_s,
                    const std::vector<std::string>& more = {});

/// A file with a boot stream of the right form and one block of `words` (fact sheet, section 4.4).
std::string image_file(std::size_t words);

}  // namespace forcegrid::hil
