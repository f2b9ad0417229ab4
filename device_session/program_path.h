// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace forcegrid::session {

/// The program `forcegrid` that belongs to this library: $FORCEGRID_PROGRAM if set, else the one in
/// bin/ of the library's own prefix (text/own_prefix.h), else the one in $PATH.
/// @throws SessionError (kUnusable) saying where it was looked for.
/// Real-time: no. Threads: any.
std::string forcegrid_program();

}  // namespace forcegrid::session
