// SPDX-License-Identifier: Apache-2.0
#include "rt/processors_awake.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstring>

namespace forcegrid::rt {

ProcessorsAwake::ProcessorsAwake(const char* file) {
  constexpr std::int32_t kLatency_us = 0;
  file_ = ::open(file, O_WRONLY | O_CLOEXEC);
  if (file_ >= 0 && ::write(file_, &kLatency_us, sizeof kLatency_us) == sizeof kLatency_us) {
    return;
  }
  const int error = errno;
  if (file_ >= 0) {
    ::close(file_);
    file_ = -1;
  }
  if (error != ENOENT) {
    refused_ = std::string("processors may sleep deeply between cycles, and wake up late (") +
               file + ": " + std::strerror(error) +
               "); run as root, or until the next start: " + "sudo chgrp plugdev " + file +
               " && sudo chmod g+w " + file;
  }
}

ProcessorsAwake::~ProcessorsAwake() {
  if (file_ >= 0) {
    ::close(file_);  // withdraws the request
  }
}

}  // namespace forcegrid::rt
