// SPDX-License-Identifier: Apache-2.0
#include "evaluation/motions/pair_motions.h"

#include <algorithm>

#include "evaluation/files/error.h"
#include "evaluation/motions/minimum_jerk.h"
#include "text/text.h"

namespace forcegrid::evaluation {
namespace {

using Eigen::Vector3d;

constexpr double kApart_m = 0.050;
constexpr double kSize = 0.6;
constexpr double kLissajousAhead_s = 3.7;
constexpr double kPokeLater_s = 0.4;
// A motion that starts in the middle of its trajectory is faded in over this time.
constexpr double kFadeIn_s = 0.5;

const Vector3d kAsItIs{kSize, kSize, kSize};
const Vector3d kMirroredInY{kSize, -kSize, kSize};
const Vector3d kMirroredInXY{-kSize, -kSize, kSize};

}  // namespace

const std::vector<std::string>& pair_motion_names() {
  static const std::vector<std::string> names{"lissajous",  "random",  "hold_random",
                                              "hold_chirp", "stretch", "poke"};
  return names;
}

std::array<PairMotion::Tool, 2> PairMotion::tools_of(const std::string& name, std::uint64_t seed) {
  const auto tool = [seed](const char* trajectory, const Vector3d& scale, double ahead_s = 0.0) {
    return Tool{Trajectory(trajectory, seed), scale, ahead_s};
  };
  if (name == "lissajous") {
    return {tool("lissajous", kAsItIs), tool("lissajous", kMirroredInY, kLissajousAhead_s)};
  }
  if (name == "random") {
    constexpr std::uint64_t kOtherSeed = 1000;
    return {tool("random", kAsItIs), Tool{Trajectory("random", seed + kOtherSeed), kAsItIs, 0.0}};
  }
  if (name == "hold_random") {
    return {tool("hold", kAsItIs), tool("random", kAsItIs)};
  }
  if (name == "hold_chirp") {
    return {tool("hold", kAsItIs), tool("chirp_oblique", kAsItIs)};
  }
  if (name == "stretch") {
    return {tool("chirp_oblique", kAsItIs), tool("chirp_oblique", kMirroredInXY)};
  }
  if (name == "poke") {
    return {tool("poke", kAsItIs), tool("poke", kAsItIs, -kPokeLater_s)};
  }
  throw ChartError("pair of motions '" + name +
                   "' is not known; known pairs: " + text::joined(pair_motion_names()));
}

PairMotion::PairMotion(const std::string& name, std::uint64_t seed)
    : name_(name), tools_(tools_of(name, seed)) {}

PairVector PairMotion::contact_points_W() noexcept {
  const Vector3d aside_W(0.0, 0.5 * kApart_m, 0.0);
  PairVector points_W;
  points_W << first_contact_point_W() - aside_W, first_contact_point_W() + aside_W;
  return points_W;
}

PairVector PairMotion::positions_W(double time_s) const noexcept {
  PairVector both_W = contact_points_W();
  for (std::size_t i = 0; i < tools_.size(); ++i) {
    const Tool& tool = tools_[i];
    const double own_s = std::max(0.0, time_s + tool.ahead_s);
    const double fade = tool.ahead_s > 0.0 ? minimum_jerk(time_s / kFadeIn_s) : 1.0;
    const Vector3d displacement_W = tool.motion.position_W(own_s) - first_contact_point_W();
    both_W.segment<3>(static_cast<Eigen::Index>(3 * i)) +=
        fade * tool.scale.cwiseProduct(displacement_W);
  }
  return both_W;
}

}  // namespace forcegrid::evaluation
