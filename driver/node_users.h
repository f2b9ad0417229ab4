// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace forcegrid::driver {

/// A process that has a device node open.
struct NodeUser {
  std::string pid;
  std::string name;
  bool locks = false;  ///< it holds this project's lock, see NodeLock
};

struct NodeUsers {
  std::vector<NodeUser> users;
  /// Processes whose open files this user may not see: those of other users, except for root. Any
  /// of them could have the node open. Kernel threads don't count.
  int hidden = 0;
};

/// Who has a node open, besides this process. Every lock is seen, whoever holds it; other open
/// files only where that is permitted.
/// @param node  as the kernel names it, e.g. "/dev/hidraw3".
/// @param file  the same node where it can be examined; in tests another file.
/// @param proc  where procfs is mounted.
/// Real-time: no. Threads: any.
NodeUsers users_of_node(const std::string& node, const std::string& file,
                        const std::string& proc = "/proc");

/// "process 4711 (forcegrid)"; several are joined by commas. Empty: nobody.
std::string names_of(const std::vector<NodeUser>& users);

/// "kill 4711 4712"
std::string command_that_ends(const std::vector<NodeUser>& users);

}  // namespace forcegrid::driver
