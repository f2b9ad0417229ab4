// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "forcegrid/core/method_options.h"
#include "forcegrid/method_variant.h"

namespace forcegrid {
#pragma GCC visibility push(default)

/// A method's name with changes to its options, as written by people: "forcegrid unit=m s=3".
/// Keys: unit (m, cells, mm or a length such as 2mm), r (30mm), s, weight, read, storage, pool
/// (blocks), cells (X,Y,Z or one number for all), ridge, nug, samples, spacing (1mm), spacing_N
/// (0.1), h (4mm), budget (bare trilinear reads a cycle).
struct MethodVariant {
  std::string text;  ///< as given, with blanks normalised
  std::string name;  ///< of the method
  MethodOptions options;
};

/// @param base the options that the text does not change.
/// @throws std::invalid_argument naming the word that can't be used and the known ones.
MethodVariant parse_method_variant(std::string_view text, const MethodOptions& base);

/// The same for two tools: the name is one of pair_method_names() or of method_names().
MethodVariant parse_pair_variant(std::string_view text, const MethodOptions& base);

#pragma GCC visibility pop
}  // namespace forcegrid
