#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <stdexcept>
#include <string>
#include <vector>

#include "evaluation/trace.h"
#include "tools/hdf5_file.h"

namespace forcegrid::tools {

/// Whether `file` is named as a recording in HDF5: .h5 or .hdf5.
bool is_recording_name(const std::string& file);

/// What a recording holds about a run as a whole. See docs/recording.md.
struct RecordingHeader {
  std::string version;  ///< of forcegrid
  std::string profile;  ///< of the device, by name
  std::string scene;    ///< empty: another program simulated
  std::vector<std::string> method_names;
  double rate_Hz = 0.0;
  std::uint64_t cycles = 0;    ///< rows that every column has
  std::uint64_t samples = 0;   ///< rows that every column has
  bool complete = false;       ///< closed by its writer, not killed
  bool has_reference = false;  ///< reference forces are in it
};

/// @throws Hdf5Error for a file that is no recording of this program.
/// Real-time: no. Threads: any, one reader each.
RecordingHeader read_header(const Hdf5Reader& reader);

/// Three numbers of each of the first `rows` rows.
std::vector<Eigen::Vector3d> read_vectors(const Hdf5Reader& reader, const std::string& column,
                                          std::uint64_t rows);

/// What reference forces are computed from, and by whom.
using SolveReference = std::function<std::vector<Eigen::Vector3d>(
    const std::string& scene, const Eigen::Vector3d& contact_point_W,
    const std::vector<Eigen::Vector3d>& positions_W)>;

/// The recording as a trace for evaluation::judge(): times since the first contact, cycles from it
/// on, reference forces from the file or, where it has none, by `solve`.
/// @throws Hdf5Error for an unreadable file, evaluation::TraceError where the tool never touched,
/// or
///         where no scene is known that could be solved.
evaluation::Trace trace_of_recording(const std::string& file, const SolveReference& solve);

}  // namespace forcegrid::tools
