// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/support/program.h"

namespace forcegrid::hil {

using forcegrid::testing::Program;

/// What a shell command said (both streams) and its exit status.
struct ShellResult {
  int status = -1;
  std::string text;
};

/// Runs `command` in the guest's shell.
ShellResult shell(const std::string& command);

/// The same as another user of the guest: "operator" is in plugdev, "visitor" in no group.
/// @param command  without single quotation marks.
ShellResult as_user(const std::string& user, const std::string& command);

/// [printed] One number for the runner's report: `HIL-MEASURED name value unit`.
void measured(const std::string& name, double value, const std::string& unit);

/// [printed] What a scenario has covered, for the matrix: `HIL-DEVICE name`, `HIL-HOST name`. Bench
/// and run() say it themselves.
void covers_device(const std::string& name);
void covers_host(const std::string& name);

/// Waits until `condition` holds, at most 20 s: software emulation is slow. @returns whether it
/// does.
bool eventually(const std::function<bool()>& condition);

/// The first line of a file; empty without one.
std::string first_line(const std::string& file);

/// Where the project's udev rule is installed.
inline constexpr char kRule[] = "/etc/udev/rules.d/10-forcegrid.rules";

/// The machine before `make install-udev`, for as long as it lives; devices attached meanwhile have
/// nodes without the rule.
class RuleTakenAway {
 public:
  RuleTakenAway();
  ~RuleTakenAway();
  RuleTakenAway(const RuleTakenAway&) = delete;
  RuleTakenAway& operator=(const RuleTakenAway&) = delete;
};

/// A hidraw node as the kernel made it, read from sysfs without the project's driver.
struct Node {
  std::string name;  ///< "hidraw0"
  std::string port;  ///< USB port as sysfs names it, e.g. "3-1"; empty without a USB device
  std::string dev() const { return "/dev/" + name; }
};

/// The nodes that there are, in the order of their ports, which is that of plugging in; those
/// without a port last. Names are given out as the kernel gets to the devices.
std::vector<Node> nodes();

/// Emulated devices in a process of their own, each attached to this kernel by a USB/IP cable.
/// Everything ends with the object.
class Bench {
 public:
  /// Starts the emulator and attaches each of `profiles`; waits until the kernel and udev are done
  /// and the firmware has armed its first report (1 s after configuration).
  explicit Bench(const std::vector<std::string>& profiles = {"woodenhaptics_v2015"},
                 const std::vector<std::string>& emulator_arguments = {});
  ~Bench();
  Bench(const Bench&) = delete;
  Bench& operator=(const Bench&) = delete;

  /// The nodes of the attached devices.
  const std::vector<Node>& nodes() const { return nodes_; }
  const Node& node() const { return nodes_.at(0); }

  /// Pulls the cable of the device that was attached at `vhci_port`, and waits until its node is
  /// gone.
  void unplug(int vhci_port = 0);
  /// Plugs device `busid` in again.
  void plug_in(const std::string& busid = "1-1");

  /// Ends the emulator. @returns its report; a list of them with several devices.
  nlohmann::json end();

 private:
  void detach_all();

  std::string report_file_;
  Program emulator_;
  std::size_t devices_;
  std::vector<Node> nodes_;
};

/// A scene file that anybody may read: a cube of 100 vertices. A tool feels 128 N/m on it, as on
/// scene "small", whose every answer would take the guest ten times as long.
std::string tiny_scene();

/// A `forcegrid run` that has ended.
// JSON moves without throwing, by functions that could.
// NOLINTNEXTLINE(bugprone-exception-escape)
struct EndedRun {
  int status = -1;
  std::string text;        ///< both streams
  nlohmann::json summary;  ///< null when it wrote none
  std::string folder;      ///< of its results
};

/// The command line of a run on the tiny scene without reference forces, results in `folder`.
std::vector<std::string> run_arguments(const std::string& device, double seconds,
                                       const std::string& folder,
                                       const std::vector<std::string>& more = {});

/// The same run, to its end.
EndedRun run(const std::string& device, double seconds, const std::vector<std::string>& more = {});

}  // namespace forcegrid::hil
