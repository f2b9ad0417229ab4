// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <iosfwd>
#include <string>
#include <vector>

#include "device_emulator/emulator_report.h"
#include "device_emulator/emulator_server.h"

namespace forcegrid::emulator {
#pragma GCC visibility push(default)

inline constexpr double kMaxTipMass_kg = 5.0;
inline constexpr double kMaxLinger_s = 60.0;
inline constexpr double kMaxClickEvery_s = 3600.0;

/// Options of `forcegrid emulate`; names as on the command line.
struct EmulatorOptions {
  std::vector<std::string> profiles;      ///< one device each: names or TOML files
  std::string listen = "127.0.0.1:3240";  ///< ADDR:PORT, loopback only
  std::string hand = "firm";              ///< firm, light, arm, none
  std::string motion = "chirp";  ///< see MotionKind; or path:FILE, see read_recorded_path()
  std::string wrist = "turn";    ///< of devices with a wrist, see WristMotionKind
  double click_every_s = 0.0;    ///< of a stylus with a button, 0: never, see OperatorScript
  std::uint64_t seed = 1;
  std::string frame_order = "out-first";  ///< out-first, in-first
  bool hand_carries_weight = true;        ///< false: for a host that compensates gravity
  bool hand_lets_go = false;              ///< see OperatorScript
  std::string hand_target;                ///< path, see ServerOptions
  double tip_mass_kg = 0.0;               ///< fastened to the tip, 0 to kMaxTipMass_kg
  bool calibrated = false;                ///< counters are true from the start; no button needed
  bool random_power_up_counters = false;  ///< counters start at random values instead of 0
  bool firmware_loaded = false;           ///< a Falcon's firmware runs from the start
  std::string core;                       ///< path, see CoreLine; only for one arm
  std::array<double, 3> contact_m{};      ///< contact point, frame D
  double amplitude_m = HandMotion::kNominalAmplitude_m;
  std::vector<std::string> faults;  ///< of every device, see FaultSpec
  double linger_s = 0.0;        ///< how long it goes on after stop_fd has ended, 0 to kMaxLinger_s
  bool says_scheduling = true;  ///< the log gets a warning if it gets no real-time scheduling
};

/// Checks the options and loads the profiles.
/// @throws EmulatorError, std::invalid_argument or profiles::ProfileError naming what is wrong.
ServerOptions server_options(const EmulatorOptions& options);

/// Serves until `stop` is true or `stop_fd` is readable or at its end. When ready it prints for
/// each device the line `listening ADDR:PORT busid 1-1 device NAME` to `out` and flushes.
/// @param stop_fd a pipe, signalfd or standard input; -1: none. Once it has ended the devices go on
/// for `linger_s`, without a host if that was the other end: what they do then is in the report.
/// @returns what each device did.
/// @throws as server_options() and EmulatorServer.
/// Real-time: no. Threads: `stop` may be set from anywhere, including a signal handler; it is read
/// every 50 ms.
std::vector<EmulatorReport> run_emulator(const EmulatorOptions& options, std::ostream& out,
                                         const std::atomic<bool>& stop, int stop_fd = -1);

#pragma GCC visibility pop
}  // namespace forcegrid::emulator
