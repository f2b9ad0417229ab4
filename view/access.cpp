// SPDX-License-Identifier: Apache-2.0
#include "view/access.h"

#include <sodium.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdlib>

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

bool host_is_right(std::string_view host, const std::string& address, std::uint16_t port) {
  for (const std::string& name :
       {address, std::string("localhost"), std::string("127.0.0.1"), std::string("::1")}) {
    const std::string with_port = address_and_port(name, port);
    if (same_in_any_case(host, with_port) ||
        (port == 80 && same_in_any_case(host, with_port.substr(0, with_port.rfind(':'))))) {
      return true;
    }
  }
  return false;
}

bool origin_is_right(std::optional<std::string_view> origin, std::string_view host) {
  return !origin || same_in_any_case(*origin, "http://" + std::string(host));
}

std::string content_security_policy(std::string_view host) {
  return "default-src 'self'; connect-src 'self' ws://" + std::string(host) +
         "; img-src 'self' data: blob:; object-src 'none'; base-uri 'none'; form-action 'none'; "
         "frame-ancestors 'none'";
}

}  // namespace forcegrid::view
