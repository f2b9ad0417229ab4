// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <string>
#include <string_view>
#include <system_error>

/// The rule for files that hold a secret: a regular file of this user's or root's, which nobody
/// else may read, write or run. All of it is in this header, so that link/ needs no other library.
/// Real-time: no. Threads: any.
namespace forcegrid::text {

/// `text` as one word of a shell.
inline std::string shell_quoted(std::string_view text) {
  std::string word = "'";
  for (const char letter : text) {
    word += letter == '\'' ? std::string("'\\''") : std::string(1, letter);
  }
  return word + "'";
}

/// Why an open file must not hold a secret, with the remedy; empty: it may.
/// @param file        its name, for the commands in the remedy
/// @param descriptor  of the open file: what is checked is what will be read
/// @param make_one    the remedy for what is no file, as "make one with 'forcegrid keygen FILE'"
/// @param danger      what somebody who has the secret can do, as "move the motors"
inline std::string fault_of_secret_file(const std::string& file, int descriptor,
                                        std::string_view make_one, std::string_view danger) {
  constexpr mode_t kOthers = S_IRWXG | S_IRWXO;
  struct stat status {};
  if (::fstat(descriptor, &status) != 0) {
    return "look at its mode: " + std::generic_category().message(errno);
  }
  if (!S_ISREG(status.st_mode)) {
    return "is not a regular file; " + std::string(make_one);
  }
  if ((status.st_mode & kOthers) != 0) {
    char mode[8];
    std::snprintf(mode, sizeof mode, "%04o", static_cast<unsigned>(status.st_mode & 07777U));
    return "its mode " + std::string(mode) + " opens it to others, and whoever has the key can " +
           std::string(danger) + "; run: chmod 600 " + shell_quoted(file) +
           ", and make a new key if others could have read this one";
  }
  if (status.st_uid != ::geteuid() && status.st_uid != 0) {
    return "belongs to another user, who could exchange it; run: sudo chown $USER " +
           shell_quoted(file);
  }
  return "";
}

}  // namespace forcegrid::text
