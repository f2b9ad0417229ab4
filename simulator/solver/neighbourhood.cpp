// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/neighbourhood.h"

#include <algorithm>

#include "simulator/solver/state_with_sensitivities.h"

namespace forcegrid::simulator {
namespace {

using kernels::Lanes;

// The change of one vertex, with the tool `way` [m] further on: x in lane 0, S in the others.
Lanes difference(const Neighbourhood::Vertex& was, const Neighbourhood::Vertex& is,
                 const Eigen::Vector3f& way) noexcept {
  const Eigen::Matrix3f s = is.sensitivity_W - was.sensitivity_W;
  const Eigen::Vector3f x = is.position_W - was.position_W + s * way;
  Lanes lanes{};
  for (int c = 0; c < 3; ++c) {
    lanes.component[c] = kernels::Float4{x[c], s(c, 0), s(c, 1), s(c, 2)};
  }
  return lanes;
}

}  // namespace

template <typename Real>
void StateWithSensitivities<Real>::copy(const std::vector<std::int32_t>& vertices,
                                        Neighbourhood& copy) const noexcept {
  copy.displacement_W = displacement_;
  const std::size_t count = std::min(vertices.size(), copy.vertices.size());
  for (std::size_t n = 0; n < count; ++n) {
    const std::size_t i = own_number_[static_cast<std::size_t>(vertices[n])];
    copy.vertices[n].position_W = standing_position(i).template cast<float>();
    copy.vertices[n].sensitivity_W = sensitivity(i).template cast<float>();
  }
}

template <typename Real>
void StateWithSensitivities<Real>::correct(const Neighbourhood& was,
                                           const Neighbourhood& is) noexcept {
  const auto count = static_cast<std::int32_t>(std::min(was.vertices.size(), is.vertices.size()));
  const std::int32_t solved = std::min(count, extent_.reach);
  const Eigen::Vector3f way = (displacement_ - was.displacement_W).template cast<float>();
  const Eigen::Vector3f saved_way =
      (saved_displacement_ - was.displacement_W).template cast<float>();
  for (std::int32_t i = 0; i < solved; ++i) {
    const auto at = static_cast<std::size_t>(i);
    if (free_[at] == 0) {
      continue;
    }
    Lanes by = difference(was.vertices[at], is.vertices[at], way);
    // Changes both states, so that a correction all at once is no trend.
    Lanes saved_by = difference(was.vertices[at], is.vertices[at], saved_way);
    for (int c = 0; c < 3; ++c) {
      if constexpr (kDouble) {
        position_[at].xyz[c] += static_cast<double>(by.component[c][0]);
        saved_position_[at].xyz[c] += static_cast<double>(saved_by.component[c][0]);
        by.component[c][0] = saved_by.component[c][0] = 0.0F;
      }
      state_[at].component[c] += by.component[c];
      saved_state_[at].component[c] += saved_by.component[c];
    }
  }
  for (std::int32_t i = solved; i < count; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const Neighbourhood::Vertex& there = is.vertices[at];
    set_position(at, there.position_W.template cast<double>());
    for (int c = 0; c < 3; ++c) {
      for (int j = 0; j < 3; ++j) {
        state_[at].component[c][1 + j] = there.sensitivity_W(c, j);
      }
    }
  }
  region_.leave_at(solved, count, is.displacement_W);
}

template void StateWithSensitivities<float>::copy(const std::vector<std::int32_t>&,
                                                  Neighbourhood&) const noexcept;
template void StateWithSensitivities<float>::correct(const Neighbourhood&,
                                                     const Neighbourhood&) noexcept;
template void StateWithSensitivities<double>::copy(const std::vector<std::int32_t>&,
                                                   Neighbourhood&) const noexcept;
template void StateWithSensitivities<double>::correct(const Neighbourhood&,
                                                      const Neighbourhood&) noexcept;

}  // namespace forcegrid::simulator
