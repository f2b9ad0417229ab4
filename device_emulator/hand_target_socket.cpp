// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/hand_target_socket.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string_view>

#include "device_emulator/listen_socket.h"

namespace forcegrid::emulator {
namespace {

static_assert(std::endian::native == std::endian::little, "a datagram is copied as it is");

constexpr std::string_view kHandWord = "hand ";

const std::string& usable(const std::string& path) {
  if (path.empty()) {
    throw EmulatorError("the hand's socket needs a path");
  }
  return path;
}

}  // namespace

HandTargetSocket::HandTargetSocket(const std::string& path) try : socket_(usable(path)) {
} catch (const EmulatorError&) {
  throw;
} catch (const std::runtime_error& error) {
  throw EmulatorError(std::string("the hand's socket ") + error.what());
}

bool HandTargetSocket::receive() noexcept {
  bool news = false;
  for (int i = 0; i < kMostAtOnce; ++i) {
    std::array<std::uint8_t, kDatagramBytes> bytes{};
    const ssize_t taken = socket_.receive(bytes);
    if (taken < 0) {
      break;
    }
    const std::span<const std::uint8_t> got(
        bytes.data(), std::min(bytes.size(), static_cast<std::size_t>(taken)));
    const bool is_sound = taken == static_cast<ssize_t>(kDatagramBytes)  ? take_target(got)
                          : taken < static_cast<ssize_t>(kDatagramBytes) ? take_hand(got)
                                                                         : false;
    ++(is_sound ? use_.taken : use_.malformed);
    news = news || is_sound;
  }
  return news;
}

bool HandTargetSocket::take_target(std::span<const std::uint8_t> bytes) noexcept {
  std::array<double, 3> target{};
  std::memcpy(target.data(), bytes.data(), bytes.size());
  const auto finite = std::count_if(target.begin(), target.end(),
                                    [](double value) { return std::isfinite(value); });
  const bool lets_go =
      std::all_of(target.begin(), target.end(), [](double value) { return std::isnan(value); });
  if (finite != 3 && !lets_go) {
    return false;
  }
  target_D_.reset();
  if (!lets_go) {
    target_D_ = Eigen::Vector3d(target[0], target[1], target[2]);
  }
  return true;
}

bool HandTargetSocket::take_hand(std::span<const std::uint8_t> bytes) noexcept {
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  const auto hand = text.substr(0, kHandWord.size()) == kHandWord
                        ? find_hand(text.substr(kHandWord.size()))
                        : std::nullopt;
  if (!hand) {
    return false;
  }
  hand_ = hand;
  static_cast<void>(socket_.reply(bytes));  // whoever does not listen needs no answer
  return true;
}

}  // namespace forcegrid::emulator
