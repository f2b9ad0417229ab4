// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

/// Who may see the page and who may command the run. Pure functions.
/// Real-time: no. Threads: any, after the first random_token() or token_is_right().
namespace forcegrid::view {

/// 32 random bytes as 64 hexadecimal digits. @throws ViewError if libsodium can't start.
std::string random_token();
/// The token of the environment variable FORCEGRID_VIEW_TOKEN, or a random one.
/// @throws ViewError for a variable with anything but 32 to 256 hexadecimal digits.
std::string token_from_environment();

/// Compares in a time that depends on the lengths alone.
bool token_is_right(std::string_view given, std::string_view token) noexcept;

/// The path of a request's target: what is before '?'.
std::string_view path_of(std::string_view target) noexcept;
/// The value of `name` in the target's query as it stands there; empty without it. A token needs no
/// percent-decoding.
std::string_view query_value(std::string_view target, std::string_view name) noexcept;

/// Where a server is.
struct Site {
  std::string address;     ///< it listens there; literal, without brackets
  std::uint16_t port = 0;  ///< it listens there
  bool encrypted = false;  ///< with TLS
  std::string machine{};   ///< this machine's name, for a server that listens on all addresses
  std::vector<std::string> names{};  ///< of its certificate, each one is_certificate_name()
};

/// An IPv4 or IPv6 address that packets to other machines never carry.
bool is_loopback(const std::string& address);

/// This machine's name, as `hostname` prints it. @throws ViewError with the system's reason.
std::string name_of_machine();

/// Whether a certificate's name is one that a browser looks up: labels of letters, digits, '-' and
/// '_', at most 253 characters, the last label not only of digits. The first one may be '*' if two
/// others follow.
bool is_certificate_name(std::string_view name);

/// Whether `name` is the certificate's, in any case. A leading '*' stands for one label.
bool matches_certificate_name(std::string_view name, std::string_view of_certificate);

/// Whether a request's Host names this server: a page of another host name that resolves to
/// this machine sends its own name. Allowed are
///   on a loopback address:  that address, localhost, 127.0.0.1 and [::1];
///   on 0.0.0.0 and [::]:    any IPv4 or IPv6 address, since no name resolves to it, and the
///                           machine's name;
///   on another address:     that address;
///   on any:                 the names of its certificate;
/// each with the port; without one where it is 80, with TLS 443.
bool host_is_right(std::string_view host, const Site& site);

/// Whether a WebSocket may be opened from `origin`: only from a page of this server. No Origin is
/// right: browsers always send one, so this is a script. `host` is one that host_is_right().
bool origin_is_right(std::optional<std::string_view> origin, std::string_view host,
                     bool encrypted = false);

/// "127.0.0.1:80" or "[::1]:80".
std::string address_and_port(const std::string& address, std::uint16_t port);

/// The value of the header Content-Security-Policy for a page of `host`. Nothing from elsewhere,
/// nothing inline, nobody's frame; WebSockets to this server alone.
std::string content_security_policy(std::string_view host, bool encrypted = false);

}  // namespace forcegrid::view
