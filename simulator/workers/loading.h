// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <iosfwd>
#include <string>

#include "rt/checkpoint.h"

namespace forcegrid::simulator {

/// Supervision of the work on a scene before a simulator or worker is ready: `stop` interrupts it,
/// and `out` gets the line `loading SCENE, N s[, about M s left]` now and then while it goes on. A
/// parent process that waits for it knows by these lines that it is at work.
/// @param out  null: nobody waits. It and `stop` must outlive the supervision.
rt::Supervision loading_supervision(const std::string& scene, const std::atomic<bool>& stop,
                                    std::ostream* out);

}  // namespace forcegrid::simulator
