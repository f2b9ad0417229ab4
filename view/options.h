// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>

namespace forcegrid::view {

/// What is wrong with a flag, an environment variable or the machine; for people, with the remedy.
class ViewError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

struct Options {
  std::string address = "127.0.0.1";  ///< literal, without brackets; without a key a loopback one
  std::uint16_t port = 0;             ///< 0: any that is free
  std::string key_file{};             ///< PEM of TLS's key and certificate; empty: without TLS
  bool until_stdin_closes = false;    ///< ends when the parent does
  std::string export_file{};          ///< a page that needs nothing else; empty: pages are served
  double export_MB = 20.0;            ///< its largest size
  bool help = false;
  bool version = false;
};

/// Reads the flags, without the program's name.
/// @throws ViewError for an unknown flag, an address that is not literal or that without a key
/// other machines reach, or a bad port. Real-time: no. Threads: any.
Options parse_options(std::span<const char* const> arguments);

/// The command line of openssl that makes a file for --key, in which HOST and ADDRESS are to be
/// replaced.
std::string_view command_for_key();

/// What --help prints.
std::string_view help_text();

}  // namespace forcegrid::view
