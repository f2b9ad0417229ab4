// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <optional>
#include <string>

#include "cli/common/child_process.h"

namespace forcegrid::cli {

/// The program forcegrid-view as a child of this process: it serves the page, and has local sockets
/// in a folder of its own (docs/view_protocol.md). It ends with this object. Threads: one.
class ViewProcess {
 public:
  /// Starts it and returns when it listens.
  /// @param listen    ADDR:PORT of the page; port 0: a free one.
  /// @param key_file  PEM of the private key and certificate of TLS; empty: without TLS, and
  ///   `listen` is a loopback address.
  /// @throws std::runtime_error if there is no such program, naming the package, or if it does not
  /// start, with its reason.
  ViewProcess(const std::string& listen, const std::string& key_file);
  /// Starts it so that it writes a recording to `export_file` instead of serving it.
  /// @throws as above, also for a file that can't be made.
  ViewProcess(const std::string& export_file, double largest_MB);

  /// What it says of the exported file, one line of JSON; nothing yet, after `timeout`.
  /// @throws std::runtime_error once it has ended without.
  std::optional<std::string> exported(std::chrono::milliseconds timeout);

  /// The page's address, with the token that gives access to it. If it listens on all addresses,
  /// this machine's name stands there.
  [[nodiscard]] const std::string& url() const noexcept { return url_; }
  /// For people: a line with url(), and with TLS one with the fingerprint of its certificate. Not
  /// for a log: it has the token.
  [[nodiscard]] std::string address_text() const;
  /// What its sockets are called, each in the private folder.
  /// @param device  number of the device that has them to itself; 0: the only one
  [[nodiscard]] std::string feed_socket() const { return folder_ + "/feed"; }
  [[nodiscard]] std::string surface_socket() const { return folder_ + "/surface"; }
  [[nodiscard]] std::string hand_socket(int device) const { return folder_ + "/hand" + of(device); }
  [[nodiscard]] std::string simulator_socket() const { return folder_ + "/simulator"; }
  [[nodiscard]] std::string run_socket(int device) const { return folder_ + "/run" + of(device); }

  /// Shows the page in the person's browser (xdg-open). @returns why not; empty: it was asked to.
  [[nodiscard]] std::string open_browser() const;

 private:
  void read_facts();
  static std::string of(int device) { return device > 0 ? "_" + std::to_string(device) : ""; }

  ChildProcess process_;
  std::string folder_;
  std::string url_;
  std::string certificate_sha256_;  ///< empty: without TLS
};

}  // namespace forcegrid::cli
