// SPDX-License-Identifier: Apache-2.0
#include "driver/node_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "driver/device.h"

namespace forcegrid::driver {
namespace {

std::string remedy_for(int reason) {
  return reason == EACCES || reason == EPERM
             ? "; install udev/70-forcegrid.rules to /etc/udev/rules.d, run `udevadm control "
               "--reload`, and plug the device in again"
             : "; plug the device in again";
}

}  // namespace

NodeLock::NodeLock(const std::string& node)
    : descriptor_(::open(node.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC)) {
  if (descriptor_ < 0) {
    const int reason = errno;
    throw DeviceError("open " + node + ": " + std::strerror(reason) + remedy_for(reason));
  }
  if (::flock(descriptor_, LOCK_EX | LOCK_NB) != 0) {
    const int reason = errno;
    ::close(descriptor_);
    throw DeviceError(
        reason == EWOULDBLOCK
            ? "open " + node + ": another program drives this device; end it first (`fuser -v " +
                  node + "` names it)"
            : "lock " + node + ": " + std::strerror(reason) + "; plug the device in again");
  }
}

NodeLock::~NodeLock() { ::close(descriptor_); }

}  // namespace forcegrid::driver
