// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/recorded_path.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <fstream>
#include <sstream>

#include "device_emulator/emulator_server.h"

namespace forcegrid::emulator {
namespace {

// The first four are needed, the others may be missing together.
constexpr std::array<const char*, 7> kColumns = {
    "time_s", "x_m", "y_m", "z_m", "gimbal_1_rad", "gimbal_2_rad", "gimbal_3_rad"};
constexpr std::size_t kNeeded = 4;

std::vector<std::string> fields_of(const std::string& line) {
  std::vector<std::string> fields;
  std::istringstream stream(line);
  for (std::string field; std::getline(stream, field, ',');) {
    if (!field.empty() && field.back() == '\r') {
      field.pop_back();
    }
    fields.push_back(field);
  }
  return fields;
}

/// The place of each of kColumns that the file has.
std::vector<std::size_t> places_of_columns(const std::string& file, const std::string& header) {
  const std::vector<std::string> names = fields_of(header);
  std::vector<std::size_t> places;
  for (std::size_t i = 0; i < kColumns.size(); ++i) {
    const auto found = std::find(names.begin(), names.end(), kColumns[i]);
    if (found != names.end()) {
      places.push_back(static_cast<std::size_t>(found - names.begin()));
    } else if (i < kNeeded) {
      throw EmulatorError(file + ":1: no column " + kColumns[i] +
                          "; a path needs the columns time_s, x_m, y_m, z_m");
    }
  }
  if (places.size() != kNeeded && places.size() != kColumns.size()) {
    throw EmulatorError(file +
                        ":1: not all of the wrist's columns; give gimbal_1_rad, gimbal_2_rad and "
                        "gimbal_3_rad, or none of them");
  }
  return places;
}

/// The two points around a time and how far it is between them; outside of the path both are its
/// first or its last.
struct Between {
  const PathPoint& from;
  const PathPoint& to;
  double fraction;
};

Between around(const std::vector<PathPoint>& path, double time_s) noexcept {
  const double at_s = path.front().time_s + time_s;
  const auto after = std::upper_bound(path.begin(), path.end(), at_s,
                                      [](double t, const PathPoint& p) { return t < p.time_s; });
  if (after == path.begin()) {
    return {path.front(), path.front(), 0.0};
  }
  const PathPoint& from = *(after - 1);
  if (after == path.end()) {
    return {from, from, 0.0};
  }
  return {from, *after, (at_s - from.time_s) / (after->time_s - from.time_s)};
}

}  // namespace

std::vector<PathPoint> read_recorded_path(const std::string& file) {
  std::ifstream stream(file);
  std::string line;
  if (!std::getline(stream, line)) {
    throw EmulatorError("path " + file + ": can't be read or is empty; name a CSV file");
  }
  const std::vector<std::size_t> places = places_of_columns(file, line);
  std::vector<PathPoint> path;
  for (std::size_t number = 2; std::getline(stream, line); ++number) {
    const std::vector<std::string> fields = fields_of(line);
    std::array<double, kColumns.size()> values{};
    for (std::size_t i = 0; i < places.size(); ++i) {
      const std::string field = places[i] < fields.size() ? fields[places[i]] : "";
      const char* const end = field.data() + field.size();
      const auto [stopped, error] = std::from_chars(field.data(), end, values[i]);
      if (error != std::errc() || stopped != end || !std::isfinite(values[i])) {
        throw EmulatorError(file + ":" + std::to_string(number) + ": '" + field + "' in column " +
                            kColumns[i] + " is not a finite number");
      }
    }
    if (!path.empty() && values[0] <= path.back().time_s) {
      throw EmulatorError(file + ":" + std::to_string(number) +
                          ": time_s does not increase; a path must go forward in time");
    }
    path.push_back({values[0], {values[1], values[2], values[3]}});
    if (places.size() == kColumns.size()) {
      path.back().gimbal_rad = Eigen::Vector3d(values[4], values[5], values[6]);
    }
  }
  if (path.size() < 2) {
    throw EmulatorError("path " + file + ": fewer than two points; record for longer");
  }
  return path;
}

Eigen::Vector3d displacement_along(const std::vector<PathPoint>& path, double time_s) noexcept {
  const Between at = around(path, time_s);
  return at.from.position_D + at.fraction * (at.to.position_D - at.from.position_D) -
         path.front().position_D;
}

Eigen::Vector3d gimbal_along(const std::vector<PathPoint>& path, double time_s) noexcept {
  const Between at = around(path, time_s);
  const Eigen::Vector3d from_rad = at.from.gimbal_rad.value_or(Eigen::Vector3d::Zero());
  const Eigen::Vector3d to_rad = at.to.gimbal_rad.value_or(from_rad);
  return from_rad + at.fraction * (to_rad - from_rad);
}

}  // namespace forcegrid::emulator
