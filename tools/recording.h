// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <stdexcept>
#include <string>
#include <vector>

#include "evaluation/traces/trace.h"
#include "tools/hdf5_file.h"

namespace forcegrid::tools {

/// Whether `file` has the name of a recording in HDF5: it ends in .h5 or .hdf5.
bool is_recording_name(const std::string& file);

/// Facts about a whole run in a recording; see docs/recording.md.
struct RecordingHeader {
  std::string version;  ///< of forcegrid
  std::string profile;  ///< of the device, by name
  std::string scene;    ///< empty: another program simulated
  std::vector<std::string> method_names;
  double rate_Hz = 0.0;
  std::uint64_t cycles = 0;    ///< rows that every column has
  std::uint64_t samples = 0;   ///< rows that every column has
  bool complete = false;       ///< closed properly by its writer
  bool has_reference = false;  ///< it holds reference forces
  int tool_number = 0;         ///< among several tools on one object; 0: the only one
  /// [m] Where the device's origin was in W.
  Eigen::Vector3d offset_W_m = Eigen::Vector3d::Zero();
};

/// Reads the header. @throws Hdf5Error for a file that is not a recording of this program.
/// Real-time: no. Threads: any, with one reader per thread.
RecordingHeader read_header(const Hdf5Reader& reader);

/// Reads a column of vectors: its first `rows` rows.
std::vector<Eigen::Vector3d> read_vectors(const Hdf5Reader& reader, const std::string& column,
                                          std::uint64_t rows);

/// Computes the reference forces [N] at `positions_W` [m].
using SolveReference = std::function<std::vector<Eigen::Vector3d>(
    const std::string& scene, const Eigen::Vector3d& contact_point_W,
    const std::vector<Eigen::Vector3d>& positions_W)>;

/// Converts the recording into a trace for evaluation::judge(). Times count from the first contact,
/// and cycles before it are left out. Reference forces come from the file or, if it has none, from
/// `solve`.
/// @throws Hdf5Error for an unreadable file, evaluation::TraceError if the tool never touched the
///         object, or if the recording names no scene that could be solved.
evaluation::Trace trace_of_recording(const std::string& file, const SolveReference& solve);

}  // namespace forcegrid::tools
