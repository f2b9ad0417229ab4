// SPDX-License-Identifier: Apache-2.0
#include "driver/falcon_firmware.h"

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "driver/device.h"

namespace forcegrid::driver::falcon {
namespace {

constexpr std::uint16_t kKey = 0x08AA;
constexpr std::size_t kReservedWords = 8;
constexpr std::size_t kHeaderBytes = 2 * (1 + kReservedWords + 2);
// Four times the memory of the device's processor: what is longer is no firmware, and isn't read.
constexpr std::uintmax_t kMaxBytes = 1 << 20;

}  // namespace

const char* firmware_advice() noexcept {
  return "the Falcon's firmware belongs to Novint and is not part of this program: take "
         "nvent_firmware.bin from the folder 'firmware' of the libnifalcon project "
         "(https://github.com/libnifalcon/libnifalcon, see its licence) and name it with "
         "--firmware FILE";
}

void check_firmware(std::span<const std::uint8_t> bytes, const std::string& name) {
  const auto refuse = [&](std::size_t at, const std::string& problem) {
    throw DeviceError("firmware '" + name + "': byte " + std::to_string(at) + ": " + problem +
                      "; it is no whole Falcon firmware, nothing was sent; " + firmware_advice());
  };
  std::size_t at = 0;
  const auto word = [&](const char* what) {
    if (bytes.size() < at + 2) {
      refuse(bytes.size(), std::string("the file ends where ") + what + " should be");
    }
    const auto value = static_cast<std::uint16_t>(bytes[at] | (bytes[at + 1] << 8));
    at += 2;
    return value;
  };
  if (word("the key 0x08AA") != kKey) {
    refuse(0, "it does not begin with the key AA 08");
  }
  for (std::size_t i = 0; i < kReservedWords; ++i) {
    if (word("a reserved word") != 0) {
      refuse(at - 2, "a reserved word is not zero");
    }
  }
  const std::uint16_t entry_high = word("the entry address");
  const std::uint16_t entry_low = word("the entry address");
  if (entry_high == 0 && entry_low == 0) {
    refuse(kHeaderBytes - 4, "the entry address is zero");
  }
  for (;;) {
    const std::size_t block_at = at;
    const std::size_t words = word("the size of a block");
    if (words == 0) {
      break;
    }
    static_cast<void>(word("the destination of a block"));
    static_cast<void>(word("the destination of a block"));
    if (bytes.size() - at < 2 * words) {
      refuse(block_at, "a block of " + std::to_string(words) + " words begins, but only " +
                           std::to_string(bytes.size() - at) + " bytes follow");
    }
    at += 2 * words;
  }
  if (at != bytes.size()) {
    refuse(at, std::to_string(bytes.size() - at) + " bytes follow the end of the stream");
  }
}

Firmware load_firmware(const std::string& file) {
  const auto refuse = [&](const std::string& problem) {
    throw DeviceError("firmware '" + file + "': " + problem + "; " + firmware_advice());
  };
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(file, error);
  if (!std::filesystem::exists(status)) {
    refuse(error && error.value() != ENOENT ? error.message() : "there is no such file");
  }
  if (!std::filesystem::is_regular_file(status)) {
    refuse("it is not a file");
  }
  const std::uintmax_t size = std::filesystem::file_size(file, error);
  if (!error && size > kMaxBytes) {
    refuse("it has " + std::to_string(size) + " bytes, and firmware has some thousands");
  }
  errno = 0;
  std::ifstream stream(file, std::ios::binary);
  Firmware firmware;
  firmware.name = file;
  if (stream) {
    firmware.bytes.assign(std::istreambuf_iterator<char>(stream), {});
  }
  if (!stream || stream.bad()) {
    refuse(std::string("it can't be read: ") + std::strerror(errno));
  }
  check_firmware(firmware.bytes, file);
  return firmware;
}

Firmware synthetic_firmware() {
  Firmware firmware;
  firmware.name = "synthetic image for the emulated Falcon";
  firmware.bytes.assign(24, 0);
  firmware.bytes[0] = 0xAA;
  firmware.bytes[1] = 0x08;
  firmware.bytes[18] = 0x3F;  // entry address 0x003F8002, high word first
  firmware.bytes[20] = 0x02;
  firmware.bytes[21] = 0x80;
  return firmware;
}

}  // namespace forcegrid::driver::falcon
