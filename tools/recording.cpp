// SPDX-License-Identifier: Apache-2.0
#include "tools/recording.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <sstream>

namespace forcegrid::tools {
namespace {

constexpr char kFormat[] = "forcegrid recording 1";

// Columns grow one after the other, so after a kill they may differ by one block.
std::uint64_t common_rows(const Hdf5Reader& reader, std::initializer_list<const char*> columns) {
  std::uint64_t rows = UINT64_MAX;
  for (const char* column : columns) {
    rows = std::min(rows, reader.rows(column));
  }
  return rows;
}

// "X,Y,Z"; zero for a recording that says nothing.
Eigen::Vector3d offset_of(const std::string& text) {
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();
  const int found = std::sscanf(text.c_str(), "%lf,%lf,%lf", &offset.x(), &offset.y(), &offset.z());
  return found == 3 && offset.allFinite() ? offset : Eigen::Vector3d::Zero();
}

struct SampleColumns {
  explicit SampleColumns(const Hdf5Reader& reader, std::uint64_t rows)
      : time_s(reader.numbers("/samples/time_s", rows)),
        delivered_s(reader.numbers("/samples/delivered_s", rows)),
        has_stiffness(reader.numbers("/samples/has_stiffness", rows)),
        stiffness(reader.numbers("/samples/stiffness_W_N_per_m", rows)),
        in_contact(reader.numbers("/samples/in_contact", rows)),
        epoch(reader.numbers("/samples/contact_epoch", rows)),
        residual(reader.numbers("/samples/relative_residual", rows)),
        converged(reader.numbers("/samples/converged", rows)),
        from_query(reader.numbers("/samples/from_query", rows)),
        position_W(read_vectors(reader, "/samples/position_W_m", rows)),
        force_W(read_vectors(reader, "/samples/force_W_N", rows)),
        contact_point_W(read_vectors(reader, "/samples/contact_point_W_m", rows)) {}

  evaluation::DeliveredSample row(std::size_t i) const {
    evaluation::DeliveredSample row;
    row.delivered_s = delivered_s[i];
    row.sample.time_s = time_s[i];
    row.sample.position_W = position_W[i];
    row.sample.force_W = force_W[i];
    row.sample.has_stiffness = has_stiffness[i] != 0.0;
    row.sample.stiffness_W =
        Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(&stiffness[9 * i]);
    row.sample.contact_epoch = static_cast<std::uint32_t>(epoch[i]);
    row.sample.contact_point_W = contact_point_W[i];
    row.sample.relative_residual = residual[i];
    row.sample.converged = converged[i] != 0.0;
    return row;
  }

  std::vector<double> time_s, delivered_s, has_stiffness, stiffness, in_contact, epoch, residual,
      converged, from_query;
  std::vector<Eigen::Vector3d> position_W, force_W, contact_point_W;
};

}  // namespace

bool is_recording_name(const std::string& file) {
  return file.ends_with(".h5") || file.ends_with(".hdf5");
}

RecordingHeader read_header(const Hdf5Reader& reader) {
  const std::string format = reader.attribute("format");
  if (format != kFormat) {
    throw Hdf5Error(
        reader.file() + ": this HDF5 file is " +
        (format.empty() ? std::string("not a recording of forcegrid") : "a '" + format + "'") +
        "; expected a '" + kFormat + "', as 'forcegrid record' writes it");
  }
  RecordingHeader header;
  header.version = reader.attribute("forcegrid_version");
  header.profile = reader.attribute("profile_name");
  header.scene = reader.attribute("scene");
  header.rate_Hz = std::strtod(reader.attribute("rate_Hz").c_str(), nullptr);
  std::istringstream names(reader.attribute("method_names"));
  for (std::string name; std::getline(names, name, ';');) {
    header.method_names.push_back(name);
  }
  // The first and the last column written.
  header.cycles = common_rows(reader, {"/cycles/time_s", "/cycles/work_on_hand_J"});
  header.samples = common_rows(reader, {"/samples/time_s", "/samples/from_query"});
  header.complete = !reader.attribute("ended").empty();
  header.has_reference = reader.has("/truth/force_W_N");
  header.tool_number =
      static_cast<int>(std::strtol(reader.attribute("tool_number").c_str(), nullptr, 10));
  header.offset_W_m = 1e-3 * offset_of(reader.attribute("offset_W_mm"));
  return header;
}

std::vector<Eigen::Vector3d> read_vectors(const Hdf5Reader& reader, const std::string& column,
                                          std::uint64_t rows) {
  const std::vector<double> numbers = reader.numbers(column, rows);
  std::vector<Eigen::Vector3d> vectors(rows);
  for (std::size_t i = 0; i < rows; ++i) {
    vectors[i] = {numbers.at(3 * i), numbers.at(3 * i + 1), numbers.at(3 * i + 2)};
  }
  return vectors;
}

evaluation::Trace trace_of_recording(const std::string& file, const SolveReference& solve) {
  const Hdf5Reader reader(file);
  const RecordingHeader header = read_header(reader);
  const SampleColumns samples(reader, header.samples);
  std::size_t first = 0;
  while (first < header.samples &&
         (samples.in_contact[first] == 0.0 || samples.from_query[first] != 0.0)) {
    ++first;
  }
  if (first == header.samples) {
    throw evaluation::TraceError(file +
                                 ": the tool never touched the object, so there is nothing to "
                                 "evaluate; record a run with contact");
  }
  const double contact_s = samples.time_s[first];

  evaluation::Trace trace;
  constexpr double kNone = -1.0;
  double epoch = kNone;
  for (std::size_t i = 0; i < header.samples; ++i) {
    if (samples.from_query[i] != 0.0) {
      continue;
    }
    evaluation::DeliveredSample row = samples.row(i);
    row.sample.time_s -= contact_s;
    row.delivered_s -= contact_s;
    if (samples.in_contact[i] == 0.0) {
      if (epoch != kNone) {
        trace.events.push_back(
            {row.sample.time_s, false, Eigen::Vector3d::Zero(), row.delivered_s});
        epoch = kNone;
      }
      continue;
    }
    if (epoch != samples.epoch[i]) {
      trace.events.push_back(
          {row.sample.time_s, true, row.sample.contact_point_W, row.delivered_s});
      epoch = samples.epoch[i];
    }
    trace.samples.push_back(row);
  }

  if (header.has_reference) {
    const std::uint64_t rows = reader.rows("/truth/force_W_N");
    const std::vector<double> time_s = reader.numbers("/truth/time_s", rows);
    const auto position_W = read_vectors(reader, "/truth/position_W_m", rows);
    const auto force_W = read_vectors(reader, "/truth/force_W_N", rows);
    for (std::size_t i = 0; i < rows; ++i) {
      trace.servo.push_back({time_s[i] - contact_s, position_W[i], force_W[i]});
    }
    return trace;
  }
  if (header.scene.empty() || !solve) {
    throw evaluation::TraceError(file +
                                 ": has no reference forces, which evaluation needs, and names no "
                                 "scene of 'forcegrid simulate' to compute them from");
  }
  if (header.tool_number > 0) {
    throw evaluation::TraceError(
        file + ": is of tool " + std::to_string(header.tool_number) +
        " of several and has no reference forces, which depend on the paths of all; record it " +
        "without --no-reference");
  }
  const std::vector<double> time_s = reader.numbers("/cycles/time_s", header.cycles);
  const std::vector<double> fault = reader.numbers("/cycles/fault", header.cycles);
  const auto all_W = read_vectors(reader, "/cycles/position_W_m", header.cycles);
  std::vector<Eigen::Vector3d> positions_W;
  for (std::size_t i = 0; i < header.cycles; ++i) {
    if (time_s[i] >= contact_s && fault[i] == 0.0) {
      trace.servo.push_back({time_s[i] - contact_s, all_W[i], Eigen::Vector3d::Zero()});
      positions_W.push_back(all_W[i]);
    }
  }
  if (positions_W.size() < 2) {
    throw evaluation::TraceError(file + ": fewer than two cycles in contact; record for longer");
  }
  const std::vector<Eigen::Vector3d> forces_W =
      solve(header.scene, samples.contact_point_W[first], positions_W);
  for (std::size_t i = 0; i < forces_W.size(); ++i) {
    trace.servo[i].force_W = forces_W[i];
  }
  return trace;
}

}  // namespace forcegrid::tools
