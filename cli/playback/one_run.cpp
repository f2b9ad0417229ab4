// SPDX-License-Identifier: Apache-2.0
#include "cli/playback/one_run.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>

namespace forcegrid::cli {
namespace {

// Of the time at which a recording began: it has whole seconds, and the world's clock may be set.
constexpr double kSameClock_s = 5.0;
constexpr double kSamePlace_m = 1e-3;

std::string number(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

[[noreturn]] void refuse(const RecordedRun& one, const RecordedRun& other, const std::string& why) {
  throw std::runtime_error(one.file() + " and " + other.file() + " are not of one run: " + why +
                           "; give the recordings of one run, RUN_device_1.h5, RUN_device_2.h5, "
                           "..., or one alone");
}

std::string scene_of(const RecordedRun& run) {
  return run.header().scene.empty() ? "another program's" : "'" + run.header().scene + "'";
}

void check_together(const RecordedRun& one, const RecordedRun& other) {
  if (one.header().tool_number == other.header().tool_number) {
    refuse(one, other, "both are of tool " + std::to_string(one.header().tool_number));
  }
  if (one.header().scene != other.header().scene) {
    refuse(one, other, "the scenes are " + scene_of(one) + " and " + scene_of(other));
  }
  const auto zero_s = one.clock_zero_utc_s();
  const auto other_zero_s = other.clock_zero_utc_s();
  if (zero_s && other_zero_s && std::abs(*zero_s - *other_zero_s) > kSameClock_s) {
    refuse(one, other,
           "their clocks began " + number("%.0f s apart", std::abs(*zero_s - *other_zero_s)) +
               ", as on two machines or after a restart");
  }
  const RecordedRun& first = one.first_ns() <= other.first_ns() ? one : other;
  const RecordedRun& second = &first == &one ? other : one;
  if (first.last_ns() < second.first_ns()) {
    refuse(one, other,
           "by their clock, " + first.file() + " ended " +
               number("%.1f s", 1e-9 * static_cast<double>(second.first_ns() - first.last_ns())) +
               " before " + second.file() + " began");
  }
  if ((one.header().offset_W_m - other.header().offset_W_m).norm() < kSamePlace_m) {
    refuse(one, other, "both devices stood at the same place of the scene");
  }
}

}  // namespace

RecordedRuns recordings_of_one_run(const std::vector<std::string>& files) {
  if (files.size() > kMostRecordings) {
    throw std::runtime_error(std::to_string(files.size()) + " recordings: a view shows at most " +
                             std::to_string(kMostRecordings) + " devices; give fewer");
  }
  RecordedRuns runs;
  for (const std::string& file : files) {
    runs.push_back(std::make_unique<RecordedRun>(file));
    if (files.size() > 1 && runs.back()->header().tool_number == 0) {
      throw std::runtime_error(file +
                               " is of a run with one device; give it alone, or the recordings of "
                               "one run with several devices");
    }
  }
  std::sort(runs.begin(), runs.end(), [](const auto& one, const auto& other) {
    return one->header().tool_number < other->header().tool_number;
  });
  SharedPlace shared{0, runs.size(), runs.front()->first_ns(), runs.front()->last_ns(), 0};
  for (std::size_t k = 0; k < runs.size(); ++k) {
    for (std::size_t other = 0; other < k; ++other) {
      check_together(*runs[other], *runs[k]);
    }
    shared.first_ns = std::min(shared.first_ns, runs[k]->first_ns());
    shared.last_ns = std::max(shared.last_ns, runs[k]->last_ns());
    if (shared.surface_frames == 0) {
      shared.surface_frames = runs[k]->surface().entries().size();
    }
  }
  for (std::size_t k = 0; k < runs.size() && runs.size() > 1; ++k) {
    shared.place = k;
    runs[k]->share(shared);
  }
  return runs;
}

}  // namespace forcegrid::cli
