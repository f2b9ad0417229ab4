// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/grid/spread_kernels_scalar.h"

#include <algorithm>
#include <cmath>

#include "forcegrid/grid/spread_kernels.h"

namespace forcegrid {
namespace {

// Zero for vertices that the sample does not reach.
float weight_at(const SpreadConstants& c, float distance2_m2) noexcept {
  if (!(distance2_m2 < c.radius2_m2)) {
    return 0.0F;
  }
  const float distance_m = std::sqrt(distance2_m2);
  const float d = distance_m * c.inverse_scale_per_m;
  if (c.kind == WeightKind::kPaper) {
    return std::max(1.0F / (1.0F + d * d) - d * c.slope, 0.0F);
  }
  const float fade = 1.0F - distance_m * c.inverse_radius_per_m;
  const float d2 = d * d;
  const float falling = c.kind == WeightKind::kInverse4 ? d2 * d2 : d2 * d2 * d2;
  return fade * fade / (0.05F + falling);
}

template <typename Segment>
void spread(const SpreadConstants& c, const SpreadSample& sample, const SegmentWork<Segment>* work,
            std::size_t count) noexcept {
  const auto& stiffness = sample.stiffness_W_N_per_m;
  for (std::size_t s = 0; s < count; ++s) {
    for (int lane = 0; lane < kSegmentVertices; ++lane) {
      const float x = work[s].x_m;
      const float y = work[s].y_m;
      const float z = work[s].z_m + static_cast<float>(lane) * c.spacing_z_m;
      const float added = weight_at(c, x * x + y * y + z * z);
      if (added <= 0.0F) {
        continue;
      }
      auto& stored = work[s].segment->vertices[static_cast<std::size_t>(lane)];
      ForceVertex vertex = unpacked(stored);
      const float weight = std::max(vertex.weight, 0.0F) + added;
      const float share = added / weight;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        float target_N = sample.force_W_N[axis];
        if (sample.has_stiffness) {
          target_N +=
              stiffness[3 * axis] * x + stiffness[3 * axis + 1] * y + stiffness[3 * axis + 2] * z;
        }
        vertex.force_W_N[axis] += share * (target_N - vertex.force_W_N[axis]);
      }
      vertex.weight = weight;
      pack(vertex, stored);
    }
  }
}

}  // namespace

SpreadConstants spread_constants(const RadialWeight& weighting, double spacing_z_m) noexcept {
  SpreadConstants constants;
  const double r = weighting.influence_radius_m;
  constants.kind = weighting.kind;
  constants.radius2_m2 = static_cast<float>(r * r);
  constants.inverse_radius_per_m = static_cast<float>(1.0 / r);
  constants.spacing_z_m = static_cast<float>(spacing_z_m);
  switch (weighting.kind) {
    case WeightKind::kPaper: {
      const double in_units = r / weighting.unit_m;
      constants.inverse_scale_per_m = static_cast<float>(1.0 / weighting.unit_m);
      constants.slope = static_cast<float>(1.0 / (in_units * (1.0 + in_units * in_units)));
      break;
    }
    case WeightKind::kInverse4:
      constants.inverse_scale_per_m = static_cast<float>(1.0 / weighting.mean_spacing_m);
      break;
    case WeightKind::kInverse6:
      constants.inverse_scale_per_m = static_cast<float>(2.0 / weighting.mean_spacing_m);
      break;
  }
  return constants;
}

void spread_force_scalar(const SpreadConstants& c, const SpreadSample& sample,
                         const SegmentWork<ForceSegment>* work, std::size_t count) noexcept {
  spread(c, sample, work, count);
}

void spread_half(const SpreadConstants& c, const SpreadSample& sample,
                 const SegmentWork<HalfSegment>* work, std::size_t count) noexcept {
  spread(c, sample, work, count);
}

void spread_moments_scalar(const SpreadConstants& c, const SpreadSample& sample,
                           const SegmentWork<MomentSegment>* work, std::size_t count) noexcept {
  for (std::size_t s = 0; s < count; ++s) {
    for (std::size_t lane = 0; lane < kSegmentVertices; ++lane) {
      const float x = work[s].x_m;
      const float y = work[s].y_m;
      const float z = work[s].z_m + static_cast<float>(lane) * c.spacing_z_m;
      const float w = weight_at(c, x * x + y * y + z * z);
      if (w <= 0.0F) {
        continue;
      }
      const std::array<float, 3> u = {-x * c.inverse_radius_per_m, -y * c.inverse_radius_per_m,
                                      -z * c.inverse_radius_per_m};
      auto& m = work[s].segment->moments;
      m[0][lane] += w;
      for (std::size_t i = 0; i < 3; ++i) {
        const float wu = w * u[i];
        const float wf = w * sample.force_W_N[i];
        m[1 + i][lane] += wu;
        m[4 + i][lane] += wu * u[i];
        m[10 + i][lane] += wf;
        for (std::size_t j = 0; j < 3; ++j) {
          m[13 + 3 * i + j][lane] += wf * u[j];
        }
      }
      m[7][lane] += w * u[0] * u[1];
      m[8][lane] += w * u[0] * u[2];
      m[9][lane] += w * u[1] * u[2];
    }
  }
}

void fit_corners_scalar(const CornerMoments& corners, double ridge, CornerForces& forces) noexcept {
  for (std::size_t corner = 0; corner < 8; ++corner) {
    const auto moment = [&](std::size_t i) {
      return static_cast<double>(corners.moments[i][corner]);
    };
    const double total = moment(0);
    for (std::size_t i = 0; i < 3; ++i) {
      forces.force_W_N[i][corner] = 0.0;
    }
    if (!(total > 0.0)) {
      continue;
    }
    const double scale = 1.0 / total;
    const std::array<double, 3> mean = {scale * moment(1), scale * moment(2), scale * moment(3)};
    const double xx = scale * moment(4) - mean[0] * mean[0] + ridge;
    const double yy = scale * moment(5) - mean[1] * mean[1] + ridge;
    const double zz = scale * moment(6) - mean[2] * mean[2] + ridge;
    const double xy = scale * moment(7) - mean[0] * mean[1];
    const double xz = scale * moment(8) - mean[0] * mean[2];
    const double yz = scale * moment(9) - mean[1] * mean[2];
    // s = C^-1 m by the adjugate of the symmetric C.
    const double a = yy * zz - yz * yz;
    const double b = xz * yz - xy * zz;
    const double d = xy * yz - xz * yy;
    const double inverse = 1.0 / (xx * a + xy * b + xz * d);
    const double e = xx * zz - xz * xz;
    const double f = xy * xz - xx * yz;
    const double g = xx * yy - xy * xy;
    const std::array<double, 3> s = {inverse * (a * mean[0] + b * mean[1] + d * mean[2]),
                                     inverse * (b * mean[0] + e * mean[1] + f * mean[2]),
                                     inverse * (d * mean[0] + f * mean[1] + g * mean[2])};
    for (std::size_t i = 0; i < 3; ++i) {
      const double mean_force_N = scale * moment(10 + i);
      double moved_N = mean_force_N;
      for (std::size_t j = 0; j < 3; ++j) {
        moved_N -= (scale * moment(13 + 3 * i + j) - mean_force_N * mean[j]) * s[j];
      }
      forces.force_W_N[i][corner] = moved_N;
    }
  }
}

}  // namespace forcegrid
