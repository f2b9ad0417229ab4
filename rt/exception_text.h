// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <exception>
#include <string>

namespace forcegrid::rt {

/// What ended a thread, for the one who started it. @returns "" for a null pointer.
/// Real-time: no.
inline std::string text_of(const std::exception_ptr& trouble) {
  if (!trouble) {
    return {};
  }
  try {
    std::rethrow_exception(trouble);
  } catch (const std::exception& error) {
    return error.what();
  } catch (...) {
    return "an exception that says nothing";
  }
}

}  // namespace forcegrid::rt
