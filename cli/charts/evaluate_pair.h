// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "cli/charts/evaluate_command.h"
#include "forcegrid/method_variant.h"

namespace forcegrid::cli {

/// A request on the command line that no trace can fulfil.
class UsageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

struct NamedVariant {
  std::string text;  ///< as given by the user, without the flags' additions
  MethodVariant variant;
};

std::vector<std::string> texts_of(const std::vector<NamedVariant>& variants);

/// The methods asked for, with these options where they say nothing else.
using VariantsOf = std::function<std::vector<NamedVariant>(const MethodOptions& base)>;

/// Evaluates the methods on a trace of two tools and writes `options.out`. A method of one tool is
/// made twice, once for each tool.
/// @returns what to print: an object for one method, an object keyed by method for several.
/// @throws UsageError, evaluation::TraceError.
nlohmann::ordered_json evaluate_pair(const EvaluateOptions& options, MethodOptions base,
                                     const VariantsOf& variants_of);

}  // namespace forcegrid::cli
