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

constexpr std::array<const char*, 4> kColumns = {"time_s", "x_m", "y_m", "z_m"};

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

std::array<std::size_t, 4> places_of_columns(const std::string& file, const std::string& header) {
  const std::vector<std::string> names = fields_of(header);
  std::array<std::size_t, 4> places{};
  for (std::size_t i = 0; i < kColumns.size(); ++i) {
    const auto found = std::find(names.begin(), names.end(), kColumns[i]);
    if (found == names.end()) {
      throw EmulatorError(file + ":1: no column " + kColumns[i] +
                          "; a path needs the columns time_s, x_m, y_m, z_m");
    }
    places[i] = static_cast<std::size_t>(found - names.begin());
  }
  return places;
}

}  // namespace

std::vector<PathPoint> read_recorded_path(const std::string& file) {
  std::ifstream stream(file);
  std::string line;
  if (!std::getline(stream, line)) {
    throw EmulatorError("path " + file + ": can't be read or is empty; name a CSV file");
  }
  const std::array<std::size_t, 4> places = places_of_columns(file, line);
  std::vector<PathPoint> path;
  for (std::size_t number = 2; std::getline(stream, line); ++number) {
    const std::vector<std::string> fields = fields_of(line);
    std::array<double, 4> values{};
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
  }
  if (path.size() < 2) {
    throw EmulatorError("path " + file + ": fewer than two points; record for longer");
  }
  return path;
}

Eigen::Vector3d displacement_along(const std::vector<PathPoint>& path, double time_s) noexcept {
  const PathPoint& first = path.front();
  const double at_s = first.time_s + time_s;
  const auto after = std::upper_bound(path.begin(), path.end(), at_s,
                                      [](double t, const PathPoint& p) { return t < p.time_s; });
  if (after == path.begin()) {
    return Eigen::Vector3d::Zero();
  }
  const PathPoint& from = *(after - 1);
  if (after == path.end()) {
    return from.position_D - first.position_D;
  }
  const double fraction = (at_s - from.time_s) / (after->time_s - from.time_s);
  return from.position_D + fraction * (after->position_D - from.position_D) - first.position_D;
}

}  // namespace forcegrid::emulator
