// SPDX-License-Identifier: Apache-2.0
#include "cli/common/standard_output.h"

#include <poll.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <iostream>
#include <string>

#include "log/log.h"

namespace forcegrid::cli {
namespace {

bool reader_has_ended() {
  pollfd output{STDOUT_FILENO, POLLOUT, 0};
  return ::poll(&output, 1, 0) > 0 && (output.revents & (POLLERR | POLLHUP)) != 0;
}

}  // namespace

int status_with_output(int status) {
  errno = 0;
  const bool flushed = std::cout.flush().good() && std::fflush(stdout) == 0;
  const int error = errno;  // 0: it was lost earlier
  if ((flushed && std::ferror(stdout) == 0) || reader_has_ended()) {
    return status;
  }
  log::error("command", std::string("standard output could not be written completely") +
                            (error != 0 ? ": " : "") + (error != 0 ? std::strerror(error) : "") +
                            "; free some space or redirect it elsewhere");
  return status == 0 ? 1 : status;
}

}  // namespace forcegrid::cli
