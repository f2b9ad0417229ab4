// SPDX-License-Identifier: Apache-2.0
// What other people's programs for this device family do with hidapi, in one small program: open by
// vendor and product, kick a silent device after each time-out of 10 ms, drain what is queued,
// write one report for each that was read. It is built twice, for hidapi's hidraw and for its
// libusb back end, and knows nothing of this project: only the bytes of the device sheet. Its
// findings go to standard output as one JSON object.

#include <hidapi.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <cwchar>
#include <string>
#include <vector>

namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr std::uint16_t kUsagePage = 0xFFAB;
constexpr int kReadTimeout_ms = 10;
constexpr int kLastRead_ms = 150;
constexpr std::size_t kUsedBytes = 14;
// Clients of the 64-byte variant send what their memory holds behind the message.
constexpr unsigned char kNoise = 0xA5;

struct Request {
  unsigned vendor = 0;
  unsigned product = 0;
  std::size_t report_bytes = kUsedBytes;
  int kick = 1;       // 0: only listen
  int listen_ms = 0;  // before anything is written
  int burst = 0;      // reports written without a look at the queue
  int exchanges = 0;  // in lockstep
  int calibrate = 0;  // 1: load the counters with (0, 0, 6000) first
  int current_mA[3] = {0, 0, 0};
};

struct Findings {
  long writes = 0, kicks = 0, reads = 0, drained = 0, other_lengths = 0, listened = 0;
  long after_burst = 0;
  int written_length = 0, read_length = 0;
  double exchange_mean_us = 0.0, exchange_max_us = 0.0;
  std::string first, calibrated, last;
};

[[noreturn]] void end_with(const char* what, hid_device* device) {
  std::fprintf(stderr, "hid_client: %s: %ls\n", what, hid_error(device));
  std::exit(2);
}

std::string hex_of(const unsigned char* bytes, int count) {
  std::string text;
  char two[4];
  for (int i = 0; i < count; ++i) {
    std::snprintf(two, sizeof two, "%02X", bytes[i]);
    text += two;
  }
  return text;
}

std::string narrow(const wchar_t* text) {
  std::string result;
  for (; *text != L'\0'; ++text) {
    result += *text >= 0x20 && *text < 0x7F && *text != L'"' ? static_cast<char>(*text) : '?';
  }
  return result;
}

class Client {
 public:
  Client(const Request& request, Findings& findings) : request_(request), findings_(findings) {
    if (hid_init() != 0) {
      end_with("hid_init", nullptr);
    }
    if (request.report_bytes == kUsedBytes) {
      device_ = hid_open(static_cast<unsigned short>(request.vendor),
                         static_cast<unsigned short>(request.product), nullptr);
    } else {
      // A composite device: its interface 0, or the one with the right usage page.
      hid_device_info* const all = hid_enumerate(static_cast<unsigned short>(request.vendor),
                                                 static_cast<unsigned short>(request.product));
      for (hid_device_info* info = all; info != nullptr && device_ == nullptr; info = info->next) {
        if (info->interface_number == 0 || info->usage_page == kUsagePage) {
          device_ = hid_open_path(info->path);
        }
      }
      hid_free_enumeration(all);
    }
    if (device_ == nullptr) {
      end_with("can't open the device", nullptr);
    }
  }
  ~Client() {
    hid_close(device_);
    hid_exit();
  }
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  std::string text(int (*get)(hid_device*, wchar_t*, std::size_t)) const {
    wchar_t buffer[128] = {};
    return get(device_, buffer, 128) == 0 ? narrow(buffer) : "";
  }

  // One OUT report: three currents [mA], the command, and three counters for command 1.
  void write(const int (&words)[7]) {
    std::vector<unsigned char> bytes(request_.report_bytes + 1, kNoise);
    bytes[0] = 0;  // the report ID slot, which does not go over the wire
    for (std::size_t i = 0; i < 7; ++i) {
      bytes[1 + 2 * i] = static_cast<unsigned char>(words[i] & 0xFF);
      bytes[2 + 2 * i] = static_cast<unsigned char>((words[i] >> 8) & 0xFF);
    }
    findings_.written_length = hid_write(device_, bytes.data(), bytes.size());
    if (findings_.written_length < 0) {
      end_with("hid_write", device_);
    }
    ++findings_.writes;
  }

  void kick() {
    write({0, 0, 0, 0, 0, 0, 0});
    ++findings_.kicks;
  }

  // One report, or nothing within the time.
  bool read(int timeout_ms) {
    unsigned char buffer[65] = {};
    // Existing clients offer one byte more than a report has.
    const int count = hid_read_timeout(device_, buffer, request_.report_bytes + 1, timeout_ms);
    if (count < 0) {
      end_with("hid_read_timeout", device_);
    }
    if (count == 0) {
      return false;
    }
    ++findings_.reads;
    findings_.read_length = count;
    findings_.other_lengths += count == static_cast<int>(request_.report_bytes) ? 0 : 1;
    findings_.last = hex_of(buffer, count);
    if (findings_.first.empty()) {
      findings_.first = findings_.last;
    }
    return true;
  }

  // The newest report: waits for one, kicks when none comes, then takes what else is queued.
  bool newest() {
    for (int attempt = 0; !read(kReadTimeout_ms); ++attempt) {
      if (attempt == 500) {
        return false;
      }
      kick();
    }
    while (read(0)) {
      ++findings_.drained;
    }
    return true;
  }

  // Until nothing more is on its way. @returns how many came.
  long read_all() {
    long count = 0;
    while (read(kLastRead_ms)) {
      ++count;
    }
    return count;
  }

 private:
  const Request& request_;
  Findings& findings_;
  hid_device* device_ = nullptr;
};

bool parse(int count, char** words, Request& request) {
  for (int i = 1; i < count; ++i) {
    const std::string word = words[i];
    const std::size_t equals = word.find('=');
    const std::string key = word.substr(0, equals);
    const std::string value = equals == std::string::npos ? "" : word.substr(equals + 1);
    const bool is_id = key == "id" && std::sscanf(value.c_str(), "%4x:%4x", &request.vendor,
                                                  &request.product) == 2;
    const bool is_current =
        key == "current" && std::sscanf(value.c_str(), "%d,%d,%d", &request.current_mA[0],
                                        &request.current_mA[1], &request.current_mA[2]) == 3;
    if (is_id || is_current) {
      continue;
    }
    if (key == "bytes" && (value == "14" || value == "64")) {
      request.report_bytes = static_cast<std::size_t>(std::atoi(value.c_str()));
    } else if (key == "kick") {
      request.kick = std::atoi(value.c_str());
    } else if (key == "listen_ms") {
      request.listen_ms = std::atoi(value.c_str());
    } else if (key == "burst") {
      request.burst = std::atoi(value.c_str());
    } else if (key == "exchanges") {
      request.exchanges = std::atoi(value.c_str());
    } else if (key == "calibrate") {
      request.calibrate = std::atoi(value.c_str());
    } else {
      std::fprintf(stderr,
                   "hid_client: '%s' is not understood; write id=VID:PID bytes=14|64 "
                   "current=A,B,C calibrate=0|1 listen_ms=N kick=0|1 burst=N exchanges=N\n",
                   word.c_str());
      return false;
    }
  }
  return request.vendor != 0;
}

}  // namespace

int main(int count, char** words) {
  Request request;
  if (!parse(count, words, request)) {
    return 2;
  }
  Findings findings;
  std::string manufacturer, product, serial;
  {
    Client client(request, findings);
    manufacturer = client.text(hid_get_manufacturer_string);
    product = client.text(hid_get_product_string);
    serial = client.text(hid_get_serial_number_string);
    const auto listen_until = Clock::now() + milliseconds(request.listen_ms);
    while (Clock::now() < listen_until) {
      findings.listened += client.read(kReadTimeout_ms) ? 1 : 0;
    }
    if (request.kick != 0) {
      if (!client.newest()) {
        std::fprintf(stderr, "hid_client: no report after 500 kicks\n");
        return 3;
      }
      if (request.calibrate != 0) {
        client.read_all();
        client.write({0, 0, 0, 1, 0, 0, 6000});
        if (!client.newest()) {
          return 3;
        }
        findings.calibrated = findings.last;
      }
      const int(&currents_mA)[3] = request.current_mA;
      for (int i = 0; i < request.burst; ++i) {
        client.write({currents_mA[0], currents_mA[1], currents_mA[2], 0, 0, 0, 0});
      }
      if (request.burst > 0) {
        findings.after_burst = client.read_all();
      }
      double sum_us = 0.0;
      for (int i = 0; i < request.exchanges; ++i) {
        const auto begun = Clock::now();
        client.write({currents_mA[0], currents_mA[1], currents_mA[2], 0, 0, 0, 0});
        if (!client.newest()) {
          std::fprintf(stderr, "hid_client: exchange %d brought no report\n", i);
          return 3;
        }
        const double took_us =
            std::chrono::duration<double, std::micro>(Clock::now() - begun).count();
        sum_us += took_us;
        findings.exchange_max_us = std::max(findings.exchange_max_us, took_us);
      }
      findings.exchange_mean_us = request.exchanges > 0 ? sum_us / request.exchanges : 0.0;
      client.write({0, 0, 0, 0, 0, 0, 0});
      client.read_all();
    }
  }
  std::printf(
      "{\"manufacturer\": \"%s\", \"product\": \"%s\", \"serial\": \"%s\", \"writes\": %ld, "
      "\"kicks\": %ld, \"reads\": %ld, \"drained\": %ld, \"listened\": %ld, \"after_burst\": %ld, "
      "\"other_lengths\": %ld, \"written_length\": %d, \"read_length\": %d, "
      "\"exchange_mean_us\": %.1f, \"exchange_max_us\": %.1f, \"first\": \"%s\", "
      "\"calibrated\": \"%s\", \"last\": \"%s\"}\n",
      manufacturer.c_str(), product.c_str(), serial.c_str(), findings.writes, findings.kicks,
      findings.reads, findings.drained, findings.listened, findings.after_burst,
      findings.other_lengths, findings.written_length, findings.read_length,
      findings.exchange_mean_us, findings.exchange_max_us, findings.first.c_str(),
      findings.calibrated.c_str(), findings.last.c_str());
  return 0;
}
