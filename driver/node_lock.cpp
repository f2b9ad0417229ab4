// SPDX-License-Identifier: Apache-2.0
#include "driver/node_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <vector>

#include "driver/device.h"
#include "driver/node_users.h"

namespace forcegrid::driver {
namespace {

std::string remedy_for(int reason) {
  return reason == EACCES || reason == EPERM
             ? "; install udev/10-forcegrid.rules to /etc/udev/rules.d, run `udevadm control "
               "--reload`, and plug the device in again"
             : "; plug the device in again";
}

std::string already_driven(const std::string& node) {
  std::vector<NodeUser> lockers = users_of_node(node, node).users;
  std::erase_if(lockers, [](const NodeUser& user) { return !user.locks; });
  return "open " + node + ": another program drives this device" +
         (lockers.empty()
              ? "; end it first (`sudo fuser -v " + node + "` names it)"
              : ": " + names_of(lockers) + "; end it first (" + command_that_ends(lockers) + ")");
}

/// Programs without a lock.
void look_for_others(const std::string& node, bool share,
                     const std::function<void(const std::string&)>& notice) {
  const NodeUsers found = users_of_node(node, node);
  if (!found.users.empty() && !share) {
    throw DeviceInUse("open " + node + ": this device is in use by " + names_of(found.users) +
                      ", which could command its motors at the same time; end it (" +
                      command_that_ends(found.users) + "), or use --share if it only listens");
  }
  if (found.hidden > 0 && notice) {
    notice(node + ": " + std::to_string(found.hidden) +
           " processes of other users can't be looked at; one that has this device open could "
           "command its motors at the same time (`sudo fuser -v " +
           node + "` names it)");
  }
}

}  // namespace

NodeLock::NodeLock(const std::string& node, bool share,
                   const std::function<void(const std::string&)>& notice)
    : descriptor_(::open(node.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC)) {
  if (descriptor_ < 0) {
    const int reason = errno;
    throw DeviceError("open " + node + ": " + std::strerror(reason) + remedy_for(reason));
  }
  if (::flock(descriptor_, LOCK_EX | LOCK_NB) != 0) {
    const int reason = errno;
    ::close(descriptor_);
    if (reason == EWOULDBLOCK) {
      throw DeviceInUse(already_driven(node));
    }
    throw DeviceError("lock " + node + ": " + std::strerror(reason) + "; plug the device in again");
  }
  try {
    look_for_others(node, share, notice);
  } catch (...) {
    ::close(descriptor_);
    throw;
  }
}

NodeLock::~NodeLock() { ::close(descriptor_); }

}  // namespace forcegrid::driver
