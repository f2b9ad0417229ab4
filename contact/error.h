// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <stdexcept>

namespace forcegrid::contact {

/// A set-up error: names the input and what to write instead.
class Error : public std::invalid_argument {
 public:
  using std::invalid_argument::invalid_argument;
};

}  // namespace forcegrid::contact
