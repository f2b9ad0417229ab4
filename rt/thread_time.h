// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace forcegrid::rt {

/// [s] Processor time of the calling thread: what its work cost, however long others had its core.
/// Real-time: yes.
double thread_time_s() noexcept;

}  // namespace forcegrid::rt
