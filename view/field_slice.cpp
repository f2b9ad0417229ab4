// SPDX-License-Identifier: Apache-2.0
#include "view/field_slice.h"

#include "view_link/little_endian.h"

namespace forcegrid::view {
namespace {

constexpr std::uint8_t kSliceType = 6;  // PageType::kField
constexpr std::uint8_t kNotCompared = 255;

void append_vector(view_link::Bytes& bytes, const Eigen::Vector3d& vector) {
  const Eigen::Vector3f rounded = vector.cast<float>();
  view_link::append(bytes, std::span<const float>(rounded.data(), 3));
}

}  // namespace

const char* problem_of(const SliceWish& wish, std::size_t methods) noexcept {
  if (wish.method >= methods || wish.compared.value_or(0) >= methods) {
    return "there is no such method";
  }
  if (wish.normal < 0 || wish.normal > 2) {
    return "normal is 0, 1 or 2, for x, y or z";
  }
  if (!(wish.size_m >= kSmallestSlice_m && wish.size_m <= kLargestSlice_m)) {
    return "size_m is 0.001 to 1";
  }
  if (wish.points < kFewestSlicePoints || wish.points > kMostSlicePoints) {
    return "points is 2 to 65";
  }
  return "";
}

view_link::Bytes slice_message(const MethodCopies& copies, const SliceWish& wish,
                               const Eigen::Vector3d& center_W) {
  const Eigen::Vector3d across_W = Eigen::Vector3d::Unit((wish.normal + 1) % 3);
  const Eigen::Vector3d along_W = Eigen::Vector3d::Unit((wish.normal + 2) % 3);
  const double step_m = wish.size_m / (wish.points - 1);
  const Eigen::Vector3d corner_W = center_W - 0.5 * wish.size_m * (across_W + along_W);

  view_link::Bytes bytes;
  view_link::append(bytes, kSliceType);
  view_link::append(bytes, static_cast<std::uint8_t>(wish.method));
  view_link::append(bytes,
                    wish.compared ? static_cast<std::uint8_t>(*wish.compared) : kNotCompared);
  view_link::append(bytes, static_cast<std::uint8_t>(wish.normal));
  view_link::append(bytes, static_cast<std::uint16_t>(wish.points));
  view_link::append(bytes, static_cast<std::uint16_t>(copies.exact() ? 1 : 0));
  append_vector(bytes, corner_W);
  append_vector(bytes, step_m * across_W);
  append_vector(bytes, step_m * along_W);
  for (int row = 0; row < wish.points; ++row) {
    for (int column = 0; column < wish.points; ++column) {
      const Eigen::Vector3d place_W = corner_W + step_m * (column * across_W + row * along_W);
      ForceEstimate estimate = copies.force(wish.method, place_W);
      if (wish.compared) {
        estimate.force_W -= copies.force(*wish.compared, place_W).force_W;
      }
      append_vector(bytes, estimate.force_W);
      view_link::append(bytes, static_cast<float>(estimate.uncertainty_N));
      view_link::append(bytes, static_cast<float>(estimate.status));
    }
  }
  return bytes;
}

}  // namespace forcegrid::view
