// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/hil/hil_bench.h"

namespace forcegrid::hil {

/// A loop that has run against a device with one fault, and what the device says of it.
// As EndedRun. NOLINTNEXTLINE(bugprone-exception-escape)
struct FaultyRun {
  EndedRun felt;
  nlohmann::json emulator;
};

/// The last command to the device's motors, whether in mA or in a Falcon's units.
extern const nlohmann::json kMotorsOff;

/// The last command to the motors, and the largest that any of them has ever got; [mA], or a
/// Falcon's units.
nlohmann::json final_command(const nlohmann::json& emulator);
double largest_command(const nlohmann::json& emulator);

/// One number of a summary or of an emulator's report.
std::int64_t number(const nlohmann::json& json, const char* key);

/// The loop ends by itself with one FAULT sentence under one of these names.
void expect_named(const FaultyRun& run, const std::vector<std::string>& names);

/// [s, printed] From the fault's first act until current last flowed.
double seconds_until_motors_off(const FaultyRun& run);

/// The motors pushed, and were off within `within_s` of the fault's first act. When the last zero
/// can't be known to have been taken, the program says who stops the motors.
void expect_motors_off(const FaultyRun& run, const std::vector<std::string>& names,
                       double within_s);

/// The same, and the program knows that the last zero was taken: the way to the motors is open.
void expect_zero_sent(const FaultyRun& run, const std::vector<std::string>& names, double within_s);

/// The same, and the program does not claim that, but leaves the motors to the device's watchdog.
void expect_watchdog(const FaultyRun& run, const std::vector<std::string>& names, double within_s);

/// The loop goes on to its end without a fault, and its last zero is taken.
void expect_endured(const FaultyRun& run);

/// What every run against a faulty device ends with: motors off, a summary, no crash. Call it with
/// the emulator's last report in `run`.
void expect_orderly_end(const FaultyRun& run);

/// A motor of joint b that pushes the wrong way is found before any force.
void expect_wrong_way_motor(const FaultyRun& run);

/// An emulated `device` that stalls its control endpoint is attached and refused: `try_to_run`
/// fails, its words contain `words`, and the motors were never on.
/// @returns the emulator's last report.
nlohmann::json expect_refused_with_stalled_control(const std::string& device,
                                                   const std::function<EndedRun()>& try_to_run,
                                                   const char* words);

/// Nothing that the kernel has said is a fault of its own.
void expect_sound_kernel();

}  // namespace forcegrid::hil
