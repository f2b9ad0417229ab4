// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <stdexcept>

namespace forcegrid::evaluation {

/// A table, chart, picture or cache can't be made. `what()` names the input and the remedy.
class ChartError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace forcegrid::evaluation
