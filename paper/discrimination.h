#pragma once

#include <array>
#include <string>
#include <vector>

#include "evaluation/force_table.h"
#include "paper/observer.h"
#include "paper/options.h"

namespace forcegrid::paper {

/// How an observer got to know the three objects.
enum class Knowledge {
  kSameRendering,  ///< through the same method: as the paper's users did
  kRealForces,     ///< by their true forces: a person who knows the real things
};
const char* to_string(Knowledge knowledge) noexcept;

/// A method's percent correct under one observer, with the objects made so much more alike.
struct DiscriminationRow {
  std::string method;  ///< "off-line": F_o itself
  Knowledge knowledge = Knowledge::kSameRendering;
  double weber_fraction = 0.0;
  /// Object i's force is mean + contrast (F_i - mean), the mean over the three objects: 1 are the
  /// objects themselves, at 0 they are the same one.
  double contrast = 1.0;
  Proportion answers;
  /// answers by object: [that it was][that it was taken for].
  std::array<std::array<std::size_t, kObjects>, kObjects> confusion{};
};

struct Discrimination {
  std::array<std::string, kObjects> objects;  ///< scenes
  std::vector<DiscriminationRow> rows;
  std::array<double, kObjects> table_difference_percent{};  ///< of the tables to live solves, RMS
  double touch_s = 0.0;                                     ///< length of a trial
  FeltNoise noise;  ///< but for the Weber fraction, which the rows have
};

/// The methods that the objects are felt through, "off-line" first.
const std::vector<std::string>& discrimination_methods();

/// Each trial: one of the three objects is grabbed and moved at random for touch_s, another motion
/// in every trial; the observer feels what the method renders and names the object.
/// @throws as evaluation::build_table(); evaluation::Stopped.
Discrimination discriminate(const PaperOptions& options);

}  // namespace forcegrid::paper
