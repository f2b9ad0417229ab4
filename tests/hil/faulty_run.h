#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/hil/hil_bench.h"

namespace forcegrid::hil {

/// A loop that has run against a device with one fault, and what the device says of it.
struct FaultyRun {
  EndedRun felt;
  nlohmann::json emulator;
};

/// All that the device's motors are told at the end, whether in mA or in a Falcon's units.
extern const nlohmann::json kMotorsOff;

/// What the motors were told last, and the largest that any of them was told ever; [mA], or a
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

/// Nothing that the kernel has said is a fault of its own.
void expect_sound_kernel();

}  // namespace forcegrid::hil
