// SPDX-License-Identifier: Apache-2.0
#include "view/access.h"

#include <arpa/inet.h>
#include <sodium.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <cstdlib>
#include <cstring>

#include "view/options.h"

namespace forcegrid::view {
namespace {

constexpr std::size_t kFewestTokenDigits = 32;
constexpr std::size_t kMostTokenDigits = 256;

char lower(char letter) {
  return static_cast<char>(std::tolower(static_cast<unsigned char>(letter)));
}

bool same_in_any_case(std::string_view a, std::string_view b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](char x, char y) { return lower(x) == lower(y); });
}

bool is_literal(int family, const std::string& address) {
  in6_addr bytes{};
  return ::inet_pton(family, address.c_str(), &bytes) == 1;
}

// "10.0.0.2", "[fe80::1]".
bool is_literal_of_url(std::string_view host) {
  return host.starts_with('[') && host.ends_with(']')
             ? is_literal(AF_INET6, std::string(host.substr(1, host.size() - 2)))
             : is_literal(AF_INET, std::string(host));
}

bool listens_everywhere(const std::string& address) {
  in_addr four{};
  in6_addr six{};
  return (::inet_pton(AF_INET, address.c_str(), &four) == 1 && four.s_addr == INADDR_ANY) ||
         (::inet_pton(AF_INET6, address.c_str(), &six) == 1 && IN6_IS_ADDR_UNSPECIFIED(&six));
}

bool is_label(std::string_view label) {
  return !label.empty() && label.size() <= 63 &&
         std::all_of(label.begin(), label.end(), [](char letter) {
           return std::isalnum(static_cast<unsigned char>(letter)) != 0 || letter == '-' ||
                  letter == '_';
         });
}

bool is_number(std::string_view label) {
  return label.find_first_not_of("0123456789") == std::string_view::npos;
}

bool is_hexadecimal(std::string_view text) {
  return std::all_of(text.begin(), text.end(), [](char letter) {
    return std::isxdigit(static_cast<unsigned char>(letter)) != 0;
  });
}

}  // namespace

std::string random_token() {
  if (sodium_init() < 0) {
    throw ViewError("libsodium does not start, so there is no token that nobody can guess");
  }
  std::array<unsigned char, 32> bytes{};
  randombytes_buf(bytes.data(), bytes.size());
  std::array<char, 2 * bytes.size() + 1> digits{};
  return sodium_bin2hex(digits.data(), digits.size(), bytes.data(), bytes.size());
}

std::string token_from_environment() {
  const char* given = std::getenv("FORCEGRID_VIEW_TOKEN");
  if (given == nullptr) {
    return random_token();
  }
  const std::string_view token = given;
  if (token.size() < kFewestTokenDigits || token.size() > kMostTokenDigits ||
      !is_hexadecimal(token)) {
    throw ViewError("FORCEGRID_VIEW_TOKEN has " + std::to_string(token.size()) +
                    " characters; it takes 32 to 256 hexadecimal digits, as `openssl rand -hex 32` "
                    "prints them");
  }
  return std::string(token);
}

bool token_is_right(std::string_view given, std::string_view token) noexcept {
  return !token.empty() && given.size() == token.size() &&
         sodium_memcmp(given.data(), token.data(), token.size()) == 0;
}

std::string_view path_of(std::string_view target) noexcept {
  return target.substr(0, target.find('?'));
}

std::string_view query_value(std::string_view target, std::string_view name) noexcept {
  const std::size_t mark = target.find('?');
  std::string_view rest =
      mark == std::string_view::npos ? std::string_view() : target.substr(mark + 1);
  while (!rest.empty()) {
    const std::string_view pair = rest.substr(0, rest.find('&'));
    rest.remove_prefix(std::min(pair.size() + 1, rest.size()));
    const std::size_t equals = pair.find('=');
    if (equals != std::string_view::npos && pair.substr(0, equals) == name) {
      return pair.substr(equals + 1);
    }
  }
  return {};
}

std::string address_and_port(const std::string& address, std::uint16_t port) {
  const bool six = address.find(':') != std::string::npos;
  return (six ? "[" + address + "]" : address) + ":" + std::to_string(port);
}

bool is_loopback(const std::string& address) {
  in_addr four{};
  if (::inet_pton(AF_INET, address.c_str(), &four) == 1) {
    return (ntohl(four.s_addr) >> 24) == 127;
  }
  in6_addr six{};
  return ::inet_pton(AF_INET6, address.c_str(), &six) == 1 && IN6_IS_ADDR_LOOPBACK(&six);
}

std::string name_of_machine() {
  std::array<char, 256> name{};
  if (::gethostname(name.data(), name.size() - 1) != 0) {
    throw ViewError(std::string("cannot learn this machine's name: ") + std::strerror(errno));
  }
  return name.data();
}

bool is_certificate_name(std::string_view name) {
  constexpr std::size_t kLongest = 253;  // of DNS
  if (name.size() > kLongest) {
    return false;
  }
  const bool wildcard = name.starts_with("*.");
  std::string_view rest = wildcard ? name.substr(2) : name;
  std::size_t labels = 0;
  while (true) {
    const std::string_view label = rest.substr(0, rest.find('.'));
    if (!is_label(label)) {
      return false;
    }
    ++labels;
    if (label.size() == rest.size()) {
      // A browser takes what ends in a number for an IPv4 address.
      return !is_number(label) && (!wildcard || labels >= 2);
    }
    rest.remove_prefix(label.size() + 1);
  }
}

bool matches_certificate_name(std::string_view name, std::string_view of_certificate) {
  if (!of_certificate.starts_with("*.")) {
    return same_in_any_case(name, of_certificate);
  }
  const std::string_view first = name.substr(0, name.find('.'));
  return is_label(first) && same_in_any_case(name.substr(first.size()), of_certificate.substr(1));
}

bool host_is_right(std::string_view host, const Site& site) {
  const std::string port = ":" + std::to_string(site.port);
  std::string_view name = host;
  if (host.ends_with(port)) {
    name.remove_suffix(port.size());
  } else if (site.port != (site.encrypted ? 443 : 80)) {
    return false;
  }
  const std::string with_port = address_and_port(site.address, site.port);
  if (same_in_any_case(name, with_port.substr(0, with_port.rfind(':')))) {
    return true;
  }
  if (std::any_of(site.names.begin(), site.names.end(),
                  [name](const std::string& own) { return matches_certificate_name(name, own); })) {
    return true;
  }
  if (is_loopback(site.address)) {
    return same_in_any_case(name, "localhost") || name == "127.0.0.1" || name == "[::1]";
  }
  return listens_everywhere(site.address) &&
         (is_literal_of_url(name) ||
          (!site.machine.empty() && same_in_any_case(name, site.machine)));
}

bool origin_is_right(std::optional<std::string_view> origin, std::string_view host,
                     bool encrypted) {
  return !origin ||
         same_in_any_case(*origin, (encrypted ? "https://" : "http://") + std::string(host));
}

std::string content_security_policy(std::string_view host, bool encrypted) {
  return std::string("default-src 'self'; connect-src 'self' ") + (encrypted ? "wss://" : "ws://") +
         std::string(host) +
         "; img-src 'self' data: blob:; object-src 'none'; base-uri 'none'; form-action 'none'; "
         "frame-ancestors 'none'";
}

}  // namespace forcegrid::view
