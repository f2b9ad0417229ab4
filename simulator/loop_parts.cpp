// SPDX-License-Identifier: Apache-2.0
#include "simulator/loop_parts.h"

#include "rt/vectors.h"

namespace forcegrid::simulator {

link::Access access_of(const SimulatorOptions& options) {
  link::Access access;
  access.keys = link::load_keys(options.key_files);
  for (const std::string& range : options.allowed) {
    access.allowed.emplace_back(range);
  }
  return access;
}

double time_s(const link::ToolState& state) noexcept {
  return 1e-9 * static_cast<double>(state.servo_time_ns);
}

void fill(link::ForceSample& sample, const StickyContact::Answer& answer, bool send_stiffness) {
  sample.contact_epoch = answer.epoch;
  sample.in_contact = answer.in_contact;
  sample.converged = answer.equilibrium.converged;
  sample.position_W_m = rt::to_array(answer.position_W);
  sample.force_W_N = rt::to_array(answer.equilibrium.force_W);
  sample.has_stiffness = send_stiffness && answer.stiffness_known;
  if (sample.has_stiffness) {
    to_row_major(answer.equilibrium.stiffness_W, sample.stiffness_W_N_per_m);
  }
  const Equilibrium& found = answer.equilibrium;
  sample.has_torque = found.torque_known;
  if (sample.has_torque) {
    const Eigen::Quaterniond& q = answer.orientation_WT;
    sample.orientation_WT = {q.w(), q.x(), q.y(), q.z()};
    sample.torque_W_Nm = rt::to_array(found.torque_W_Nm);
  }
  sample.has_rotational_stiffness =
      send_stiffness && found.torque_known && found.rotational_stiffness_known;
  if (sample.has_rotational_stiffness) {
    to_row_major(found.rotational_stiffness_W_Nm_per_rad, sample.rotational_stiffness_W_Nm_per_rad);
  }
  sample.has_torque_gradient = sample.has_rotational_stiffness;
  if (sample.has_torque_gradient) {
    to_row_major(found.torque_gradient_W_N, sample.torque_gradient_W_N);
  }
  sample.contact_point_W_m = rt::to_array(answer.point_W);
  sample.relative_residual = answer.equilibrium.relative_residual;
  sample.solve_time_s = answer.equilibrium.solve_time_s;
}

void show_timed(SurfaceStream& surface, const SurfaceStream::CopyPositions& copy_positions,
                rt::Percentiles& show_us) {
  const auto sent = [&surface] {
    const SurfaceStream::Counts counts = surface.counts();
    return counts.frames + counts.inside_frames;
  };
  const std::uint64_t before = sent();
  const rt::TimePoint start = rt::Clock::now();
  surface.show(copy_positions);
  if (sent() != before) {
    show_us.add(1e6 * rt::seconds(rt::Clock::now() - start));
  }
}

SurfaceUse surface_use(const SurfaceStream& surface, const rt::Percentiles& show_us) {
  const SurfaceStream::Counts counts = surface.counts();
  return {.frames = counts.frames,
          .inside_frames = counts.inside_frames,
          .dropped = counts.dropped,
          .view_lost = counts.lost,
          .mean_ms = 1e-3 * show_us.mean(),
          .max_ms = 1e-3 * show_us.max()};
}

}  // namespace forcegrid::simulator
