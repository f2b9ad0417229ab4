// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace forcegrid::cli {

/// Returns the exit status of a command that would end with `status`. If some of its standard
/// output was lost (a full disk), prints a message to standard error and returns 1 in place of 0. A
/// reader that ended early (`forcegrid config | head`) is not an error.
int status_with_output(int status);

}  // namespace forcegrid::cli
