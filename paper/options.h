// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "forcegrid/core/force_method.h"

namespace forcegrid::paper {

inline constexpr double kServoRate_Hz = 500.0;     ///< the paper's haptic rate
inline constexpr double kSimulatorRate_Hz = 30.0;  ///< the paper's simulator

/// The three objects of the discrimination test.
inline constexpr std::size_t kObjects = 3;

/// Scenes, motions and parameters of the experiments.
struct Plan {
  /// Scene of Figures 7 and 8 and of the resolutions: the paper's 10,000 vertices and 35,000 edges.
  std::string scene = "organ";
  /// Motions of the resolutions, of one contact each; the first is that of the figures.
  std::vector<std::string> motions{"chirp", "random"};
  /// Further scenes on which the methods that the paper names are compared, on the same motions:
  /// the paper's stomach of 4,000 vertices and 11,000 edges.
  std::vector<std::string> compared_scenes{"stomach"};
  std::vector<int> vertices{25, 50, 100};  ///< along each axis of the grid; 50 is the paper's
  /// r over the workspace's longest edge; 1/6 is the paper's.
  std::vector<double> radii_of_workspace{1.0 / 48, 1.0 / 24, 1.0 / 16, 1.0 / 12,
                                         1.0 / 8,  1.0 / 6,  1.0 / 4,  1.0 / 3};
  /// Three objects of the same shape: stiff, soft and strongly varying springs.
  std::array<std::string, kObjects> objects{"discrimination_stiff", "discrimination_soft",
                                            "discrimination_varied"};
  int touches = 100;  ///< trials with each object, by each observer, at each contrast
  /// Scales of the differences between the objects, see DiscriminationRow::contrast; must include
  /// 1.
  std::vector<double> contrasts{1.0, 0.5, 0.25, 0.12, 0.06, 0.03, 0.0};
};

/// A plan that takes at most about twenty minutes, or with `quick` about two.
Plan plan_of(bool quick);

/// Options of `forcegrid paper`.
struct PaperOptions {
  std::filesystem::path out;    ///< folder for pictures, tables and the page
  std::filesystem::path cache;  ///< folder of force tables and reference forces; empty: none
  Plan plan;
  unsigned jobs = 0;                            ///< threads that solve; 0: one per processor
  std::uint64_t seed = 1;                       ///< of motions and of the observers' noise
  std::function<void(const std::string&)> say;  ///< receives facts, one line each
  /// Receives the current activity, the fraction done in [0, 1] and the time left [s].
  std::function<void(const std::string& what, double done, double remaining_s)> progress;
  const std::atomic<bool>* cancel = nullptr;  ///< when set and true: evaluation::Stopped is thrown
};

/// @throws evaluation::Stopped if options.cancel is set.
void check_stop(const PaperOptions& options);

/// Makes a method from its text, e.g. "forcegrid unit=m". Unless the text changes it, its grid is
/// the paper's: 50 x 50 x 50 vertices over a workspace of 0.16 x 0.12 x 0.12 m.
/// @throws std::invalid_argument for an invalid text.
std::unique_ptr<ForceMethod> make_method(const std::string& text);

}  // namespace forcegrid::paper
