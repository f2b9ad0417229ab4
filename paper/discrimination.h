// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <string>
#include <vector>

#include "evaluation/objects/force_table.h"
#include "paper/observer.h"
#include "paper/options.h"

namespace forcegrid::paper {

/// How an observer has learned the three objects.
enum class Knowledge {
  kSameRendering,  ///< through the same method, as the paper's users did
  kRealForces,     ///< by their reference forces, like a person who knows the real objects
};
const char* to_string(Knowledge knowledge) noexcept;

/// Answers of one observer with one method, with the differences between the objects scaled by
/// `contrast`.
struct DiscriminationRow {
  std::string method;  ///< "off-line": the reference force F_o itself
  Knowledge knowledge = Knowledge::kSameRendering;
  double weber_fraction = 0.0;
  /// Object i's force is mean + contrast (F_i - mean), with the mean over the three objects. At 1
  /// the objects are unchanged, at 0 they are identical.
  double contrast = 1.0;
  Proportion answers;
  /// answers by object: [actual object][answered object].
  std::array<std::array<std::size_t, kObjects>, kObjects> confusion{};
};

struct Discrimination {
  std::array<std::string, kObjects> objects;  ///< scenes
  std::vector<DiscriminationRow> rows;
  std::array<double, kObjects> table_difference_percent{};  ///< of the tables from live solves, RMS
  double touch_s = 0.0;                                     ///< length of a trial
  FeltNoise noise;  ///< except the Weber fraction, which the rows hold
};

/// Returns the methods that render the objects to the observer; "off-line" comes first.
const std::vector<std::string>& discrimination_methods();

/// Runs all trials. In each trial the tool grabs one of the three objects and moves at random for
/// touch_s, with another motion in every trial. The observer feels the force that the method
/// renders and names the object.
/// @throws as evaluation::build_table(); evaluation::Stopped.
Discrimination discriminate(const PaperOptions& options);

}  // namespace forcegrid::paper
