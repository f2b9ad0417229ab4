// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace forcegrid::driver {

using Bytes = std::vector<std::uint8_t>;

/// How the server behaves. Set before it starts, except the atomics.
struct Script {
  Bytes device_descriptor = {0x12, 0x01, 0x00, 0x02, 0x00, 0x00, 0x00, 0x40, 0x34,
                             0x12, 0x06, 0x00, 0x01, 0x00, 0x01, 0x02, 0x03, 0x01};
  Bytes configuration_descriptor = {
      0x09, 0x02, 0x29, 0x00, 0x01, 0x01, 0x00, 0xC0, 0x00, 0x09, 0x04, 0x00, 0x00, 0x02,
      0x03, 0x00, 0x00, 0x00, 0x09, 0x21, 0x11, 0x01, 0x00, 0x01, 0x22, 0x1B, 0x00, 0x07,
      0x05, 0x81, 0x03, 0x40, 0x00, 0x01, 0x07, 0x05, 0x01, 0x03, 0x40, 0x00, 0x01};
  Bytes report_descriptor = {0x06, 0xAB, 0xFF, 0x0A, 0x00, 0x02, 0xA1, 0x01, 0x75,
                             0x08, 0x15, 0x00, 0x25, 0xFF, 0x95, 0x0E, 0x09, 0x01,
                             0x81, 0x02, 0x95, 0x0E, 0x09, 0x02, 0x91, 0x02, 0xC0};
  std::array<std::string, 3> strings = {"mbed.org", "HID DEVICE", "0123456789"};
  std::size_t wire_bytes = 14;  ///< length of a report; beyond 14 the device sends noise
  std::uint32_t import_status = 0;
  std::uint16_t import_version = 0x0111;
  std::string import_bus_id = "1-1";
  bool answer_import = true;
  bool answer_control = true;
  bool answer_unlink = true;
  bool take_outs = true;
  bool has_wrist = true;    ///< false: counters d, e, f stay 0 whatever it is told
  bool speak_first = true;  ///< W2: one report before the first OUT

  std::atomic<bool> send_reports{true};  ///< false: OUTs are taken, no report follows
  /// A bus that serves IN before OUT: a report is collected when the next OUT comes, just before
  /// it.
  std::atomic<bool> in_first{false};
  /// So many of the next OUTs are followed by a report more: an answer to somebody else.
  std::atomic<int> foreign_outs{0};
  std::atomic<int> foreign_step{1};          ///< [counts] by which it differs from the one before
  std::atomic<int> arm_step{0};              ///< [counts] by which each OUT finds the arm moved
  std::atomic<int> merge_outs{0};            ///< so many of the next OUTs release no report
  std::atomic<int> wrong_length_reports{0};  ///< so many of the next reports have 13 bytes
  std::atomic<int> report_status{0};         ///< USB status of the next report, e.g. -ENODEV
  std::atomic<int> close_after_outs{-1};     ///< the connection ends after so many more OUTs
  /// Bytes sent instead of the answer to an OUT, if any, once.
  std::function<Bytes(std::uint32_t sequence)> lie;
  std::atomic<bool> lie_now{false};
};

/// A USB/IP server with one scripted W2 device, for one client, written against the kernel's
/// protocol document and the device sheet only.
class ScriptedUsbipServer {
 public:
  explicit ScriptedUsbipServer(Script& script);
  ~ScriptedUsbipServer();
  ScriptedUsbipServer(const ScriptedUsbipServer&) = delete;
  ScriptedUsbipServer& operator=(const ScriptedUsbipServer&) = delete;

  std::string url() const;

  void set_counts(const std::array<std::int32_t, 6>& counts);
  std::array<std::int32_t, 6> counts() const;
  void press_button() { button_ = true; }

  /// OUT reports that the device took, in order.
  std::vector<Bytes> outs() const;
  /// Setup packets of the control transfers, in order.
  std::vector<Bytes> setups() const;
  int unlinks() const { return unlinks_; }
  bool client_gone() const { return client_gone_; }

 private:
  void serve();
  bool serve_client(int client);
  bool receive(int client, std::uint8_t* bytes, std::size_t size);
  bool import(int client);
  bool submit(int client, const Bytes& header);
  bool control(int client, const Bytes& header);
  bool out(int client, const Bytes& header);
  bool unlink(int client, const Bytes& header);
  bool deliver(int client);
  Bytes descriptor(std::uint8_t type, std::uint8_t number) const;

  Script& script_;
  int listener_ = -1;
  std::uint16_t port_ = 0;
  std::atomic<bool> ending_{false};
  std::atomic<bool> client_gone_{false};
  std::atomic<bool> button_{false};
  std::atomic<int> unlinks_{0};

  mutable std::mutex mutex_;
  std::array<std::int32_t, 6> counts_{};
  std::vector<Bytes> outs_;
  std::vector<Bytes> setups_;

  bool armed_ = false;
  std::uint32_t pending_in_ = 0;
  std::uint32_t pending_out_ = 0;
  std::thread thread_;
};

}  // namespace forcegrid::driver
