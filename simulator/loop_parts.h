// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <chrono>

#include "link/messages.h"
#include "link/simulator_endpoint.h"
#include "rt/percentiles.h"
#include "simulator/run_simulator.h"
#include "simulator/simulator_summary.h"
#include "simulator/surface_stream.h"
#include "simulator/touch/sticky_contact.h"

namespace forcegrid::simulator {

/// Of a servo, before another one may take its place.
inline constexpr auto kServoSilence = std::chrono::seconds(2);

/// Who may use the simulator, as the options say. Throws link::LinkError for a key file or a range
/// that cannot be used.
link::Access access_of(const SimulatorOptions& options);

/// [s] When the tool was there, by the servo's clock.
double time_s(const link::ToolState& state) noexcept;

/// Writes a matrix as messages carry it.
inline void to_row_major(const Eigen::Matrix3d& from, link::Matrix3& to) {
  Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(to.data()) = from;
}

/// Writes the object's reaction into a sample.
void fill(link::ForceSample& sample, const StickyContact::Answer& answer, bool send_stiffness);

/// Sends the surface and the inside where they are due, and adds how long it took to `show_us` if
/// anything was sent.
void show_timed(SurfaceStream& surface, const SurfaceStream::CopyPositions& copy_positions,
                rt::Percentiles& show_us);
/// What was sent to the live view. @param show_us  of show_timed().
SurfaceUse surface_use(const SurfaceStream& surface, const rt::Percentiles& show_us);

}  // namespace forcegrid::simulator
