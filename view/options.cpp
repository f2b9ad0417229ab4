// SPDX-License-Identifier: Apache-2.0
#include "view/options.h"

#include <arpa/inet.h>

#include <charconv>

#include "view/access.h"

namespace forcegrid::view {
namespace {

constexpr std::string_view kHelp =
    R"(forcegrid-view: shows a run of forcegrid in a browser.
usage: forcegrid-view [--listen ADDRESS:PORT [--key FILE] | --export FILE [--export-MB N]]
                      [--until-stdin-closes]

`forcegrid run --view` starts this program and feeds it. Its first line of output is
  listening ADDRESS:PORT folder FOLDER token TOKEN
and the page is http://ADDRESS:PORT/?token=TOKEN. FOLDER has the sockets `feed` and `surface`.
With --key the line ends with ` certificate SHA256`, and the page is https://ADDRESS:PORT/...

  --listen ADDRESS:PORT  where browsers connect, 127.0.0.1:0 if it is not given; port 0 is any
                         that is free. Without --key only addresses of this machine itself:
                         127.*.*.* and [::1]
  --key FILE             encrypt with the private key and certificate of this PEM file (TLS), on
                         any address; only its owner may read it
  --export FILE          serve no page: write the recording that comes over the sockets to FILE,
                         as a page that needs nothing else, and end
  --export-MB N          the file's largest size, 5 to 500; 20 if it is not given
  --until-stdin-closes   end when standard input is closed
  --help                 print this and end
  --version              print the version and end

Environment:
  FORCEGRID_VIEW_TOKEN   the token, at least 32 hexadecimal digits; a random one if it is not set
)";

// It writes both into one file, which only its owner may read.
constexpr std::string_view kCommandForKey =
    "openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 365 "
    "-subj /CN=HOST -addext subjectAltName=DNS:HOST,IP:ADDRESS -keyout view.pem -out view.pem";

constexpr double kSmallestExport_MB = 5.0;
constexpr double kLargestExport_MB = 500.0;

bool is_literal(const std::string& address) {
  in6_addr bytes{};
  return ::inet_pton(AF_INET, address.c_str(), &bytes) == 1 ||
         ::inet_pton(AF_INET6, address.c_str(), &bytes) == 1;
}

void set_listen(Options& options, const std::string& text) {
  const std::size_t colon = text.rfind(':');
  if (colon == std::string::npos) {
    throw ViewError("--listen " + text + ": it has no port; use ADDRESS:PORT, as 127.0.0.1:8080");
  }
  std::string address = text.substr(0, colon);
  if (address.size() >= 2 && address.front() == '[' && address.back() == ']') {
    address = address.substr(1, address.size() - 2);
  } else if (address.find(':') != std::string::npos) {
    throw ViewError("--listen " + text + ": an IPv6 address stands in brackets, as [::1]:8080");
  }
  if (address == "localhost") {
    address = "127.0.0.1";
  }
  if (!is_literal(address)) {
    throw ViewError("--listen " + text + ": '" + address +
                    "' is no address; use 127.0.0.1, [::1] or localhost");
  }
  const std::string port = text.substr(colon + 1);
  const auto [end, error] = std::from_chars(port.data(), port.data() + port.size(), options.port);
  if (error != std::errc() || end != port.data() + port.size() || port.empty()) {
    throw ViewError("--listen " + text + ": '" + port + "' is no port; use 0 to 65535");
  }
  options.address = address;
}

// `text` is what --listen was given.
void check_address(const Options& options, const std::string& text) {
  if (options.key_file.empty() && !is_loopback(options.address)) {
    throw ViewError("--listen " + text + ": other machines reach " + options.address +
                    ", and the page is not encrypted; give --key FILE (of forcegrid: --view-key "
                    "FILE), which you make with: " +
                    std::string(kCommandForKey) +
                    "; or use 127.0.0.1:8080, and from elsewhere a tunnel, `ssh -L "
                    "8080:127.0.0.1:8080 HOST`");
  }
}

void set_key(Options& options, const std::string& file) {
  if (file.empty()) {
    throw ViewError("--key: the file's name is empty; use --key FILE.pem");
  }
  options.key_file = file;
}

void set_export(Options& options, const std::string& file) {
  if (file.empty()) {
    throw ViewError("--export: the file's name is empty; use --export FILE.html");
  }
  options.export_file = file;
}

void set_export_MB(Options& options, const std::string& text) {
  const auto [end, error] =
      std::from_chars(text.data(), text.data() + text.size(), options.export_MB);
  if (error != std::errc() || end != text.data() + text.size() ||
      !(options.export_MB >= kSmallestExport_MB && options.export_MB <= kLargestExport_MB)) {
    throw ViewError("--export-MB " + text + ": use a number from 5 to 500");
  }
}

}  // namespace

Options parse_options(std::span<const char* const> arguments) {
  Options options;
  std::string listen;
  for (std::size_t i = 0; i < arguments.size(); ++i) {
    const std::string_view word = arguments[i];
    if (word == "--listen" || word.starts_with("--listen=")) {
      const bool together = word != "--listen";
      if (!together && i + 1 == arguments.size()) {
        throw ViewError("--listen: the address is missing; use --listen ADDRESS:PORT");
      }
      listen = together ? std::string(word.substr(word.find('=') + 1)) : arguments[++i];
      set_listen(options, listen);
    } else if (word == "--export" || word == "--export-MB" || word == "--key") {
      if (i + 1 == arguments.size()) {
        throw ViewError(std::string(word) + ": its value is missing");
      }
      const std::string value = arguments[++i];
      word == "--key"      ? set_key(options, value)
      : word == "--export" ? set_export(options, value)
                           : set_export_MB(options, value);
    } else if (word == "--until-stdin-closes") {
      options.until_stdin_closes = true;
    } else if (word == "--help" || word == "-h") {
      options.help = true;
    } else if (word == "--version") {
      options.version = true;
    } else {
      throw ViewError("unknown argument '" + std::string(word) + "'; see forcegrid-view --help");
    }
  }
  check_address(options, listen);
  if (!options.key_file.empty() && !options.export_file.empty()) {
    throw ViewError(
        "--key: --export serves no page that could be encrypted; leave one of them out");
  }
  return options;
}

std::string_view command_for_key() { return kCommandForKey; }

std::string_view help_text() { return kHelp; }

}  // namespace forcegrid::view
