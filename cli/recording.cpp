#include "cli/recording.h"

#include <optional>
#include <stdexcept>

#include "evaluation/text_file.h"

namespace forcegrid::cli {

void check_recording(const RunOptions& options) {
  if (options.record.empty()) {
    return;
  }
  if (options.no_truth) {
    throw std::runtime_error(
        "--record needs the off-line forces, by which a trace is judged, and --no-truth skips "
        "them; leave one of the two out");
  }
  if (!options.simulator.empty()) {
    throw std::runtime_error(
        "--record needs the off-line forces, by which a trace is judged, and only the scenes of "
        "'forcegrid simulate' can be solved off line; use --scene instead of --simulator");
  }
  try {
    const evaluation::TextWriter probe(options.record);
  } catch (const evaluation::FileError& error) {
    throw evaluation::TraceError(std::string("--record ") + error.what());
  }
}

evaluation::Trace trace_of(const std::deque<servo::ArrivedSample>& samples,
                           const std::vector<const servo::CycleRecord*>& cycles,
                           const std::vector<Eigen::Vector3d>& truth_W, std::int64_t contact_ns) {
  const double contact_s = 1e-9 * static_cast<double>(contact_ns);
  evaluation::Trace trace;
  for (std::size_t i = 0; i < cycles.size(); ++i) {
    trace.servo.push_back({1e-9 * static_cast<double>(cycles[i]->time_ns - contact_ns),
                           servo::vector(cycles[i]->touching_W_m), truth_W.at(i)});
  }
  // The epoch of the present contact, as the servo knew it.
  std::optional<std::uint32_t> contact;
  for (const servo::ArrivedSample& arrived : samples) {
    if (arrived.sample.from_query) {
      continue;
    }
    evaluation::DeliveredSample row;
    row.sample = arrived.sample;
    row.sample.time_s -= contact_s;
    row.delivered_s = rt::seconds(arrived.arrived.time_since_epoch()) - contact_s;
    if (!arrived.in_contact) {
      if (contact) {
        trace.events.push_back(
            {row.sample.time_s, false, Eigen::Vector3d::Zero(), row.delivered_s});
        contact.reset();
      }
      continue;
    }
    if (contact != arrived.sample.contact_epoch) {
      trace.events.push_back(
          {row.sample.time_s, true, arrived.sample.contact_point_W, row.delivered_s});
      contact = arrived.sample.contact_epoch;
    }
    trace.samples.push_back(row);
  }
  return trace;
}

}  // namespace forcegrid::cli
