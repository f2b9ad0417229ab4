#include "driver/hid_descriptor.h"

#include <vector>

#include "driver/device.h"

namespace forcegrid::driver {
namespace {

constexpr std::size_t kMaxDescriptorBytes = 4096;  // as Linux's HID_MAX_DESCRIPTOR_SIZE
constexpr std::uint64_t kMaxReportBits = 8 * 4096;
constexpr std::size_t kMaxDepth = 16;

enum ItemType : unsigned { kMain = 0, kGlobal = 1, kLocal = 2 };
enum MainTag : unsigned {
  kInput = 8,
  kOutput = 9,
  kCollection = 10,
  kFeature = 11,
  kEndCollection = 12
};
enum GlobalTag : unsigned {
  kUsagePage = 0,
  kReportSize = 7,
  kReportId = 8,
  kReportCount = 9,
  kPush = 10,
  kPop = 11
};
constexpr unsigned kLastLocalTag = 10;
constexpr unsigned kUsage = 0;
constexpr std::uint32_t kApplication = 1;

[[noreturn]] void fail(std::size_t offset, const std::string& what) {
  throw DeviceError("HID report descriptor, byte " + std::to_string(offset) + ": " + what);
}

struct Globals {
  std::uint32_t usage_page = 0;
  std::uint32_t report_size = 0;
  std::uint32_t report_count = 0;
};

std::size_t whole_bytes(std::uint64_t bits, const char* kind) {
  if (bits % 8 != 0) {
    throw DeviceError(std::string("HID report descriptor: the ") + kind + " report has " +
                      std::to_string(bits) + " bits, no whole number of bytes");
  }
  return static_cast<std::size_t>(bits / 8);
}

}  // namespace

HidInterface parse_hid_descriptor(std::span<const std::uint8_t> descriptor) {
  if (descriptor.empty() || descriptor.size() > kMaxDescriptorBytes) {
    throw DeviceError("HID report descriptor: it has " + std::to_string(descriptor.size()) +
                      " bytes");
  }
  HidInterface result;
  Globals globals;
  std::vector<Globals> pushed;
  std::size_t depth = 0;
  bool found_application = false;
  // A usage of four bytes carries its own page in the upper half.
  bool has_usage = false;
  std::uint32_t first_usage = 0;
  std::uint64_t input_bits = 0;
  std::uint64_t output_bits = 0;
  std::uint64_t feature_bits = 0;

  std::size_t at = 0;
  while (at < descriptor.size()) {
    const std::size_t start = at;
    const unsigned prefix = descriptor[at++];
    if (prefix == 0xFE) {
      fail(start, "a long item, which HID 1.11 reserves");
    }
    const std::size_t size = (prefix & 3) == 3 ? 4 : prefix & 3;
    if (descriptor.size() - at < size) {
      fail(start, "the item needs " + std::to_string(size) + " more bytes and " +
                      std::to_string(descriptor.size() - at) + " are left");
    }
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < size; ++i) {
      value |= static_cast<std::uint32_t>(descriptor[at + i]) << (8 * i);
    }
    at += size;
    const unsigned type = (prefix >> 2) & 3;
    const unsigned tag = prefix >> 4;

    if (type == kMain) {
      switch (tag) {
        case kInput:
        case kOutput:
        case kFeature: {
          if (depth == 0) {
            fail(start, "a report field outside any collection");
          }
          std::uint64_t& bits =
              tag == kInput ? input_bits : (tag == kOutput ? output_bits : feature_bits);
          bits += static_cast<std::uint64_t>(globals.report_size) * globals.report_count;
          if (bits > kMaxReportBits) {
            fail(start, "a report of more than " + std::to_string(kMaxReportBits / 8) + " bytes");
          }
          break;
        }
        case kCollection:
          if (++depth > kMaxDepth) {
            fail(start, "collections nested deeper than " + std::to_string(kMaxDepth));
          }
          if (value == kApplication && !found_application) {
            if (!has_usage) {
              fail(start, "an application collection without a usage");
            }
            found_application = true;
            const std::uint32_t page =
                first_usage > 0xFFFF ? first_usage >> 16 : globals.usage_page;
            result.usage_page = static_cast<std::uint16_t>(page);
            result.usage = static_cast<std::uint16_t>(first_usage & 0xFFFF);
          }
          break;
        case kEndCollection:
          if (depth == 0) {
            fail(start, "the end of a collection that was not begun");
          }
          --depth;
          break;
        default:
          fail(start, "unknown main item");
      }
      has_usage = false;
    } else if (type == kGlobal) {
      switch (tag) {
        case kUsagePage:
          if (value > 0xFFFF) {
            fail(start, "a usage page above 0xFFFF");
          }
          globals.usage_page = value;
          break;
        case kReportSize:
          globals.report_size = value;
          break;
        case kReportId:
          result.has_report_ids = true;
          break;
        case kReportCount:
          globals.report_count = value;
          break;
        case kPush:
          if (pushed.size() >= kMaxDepth) {
            fail(start, "more than " + std::to_string(kMaxDepth) + " pushed states");
          }
          pushed.push_back(globals);
          break;
        case kPop:
          if (pushed.empty()) {
            fail(start, "a pop without a push");
          }
          globals = pushed.back();
          pushed.pop_back();
          break;
        default:  // limits, exponent and unit of the values do not matter here
          if (tag > kPop) {
            fail(start, "unknown global item");
          }
      }
    } else if (type == kLocal) {
      if (tag > kLastLocalTag) {
        fail(start, "unknown local item");
      }
      if (tag == kUsage && !has_usage) {
        has_usage = true;
        first_usage = value;
      }
    } else {
      fail(start, "reserved item type");
    }
  }
  if (depth != 0) {
    fail(at, "it ends inside a collection");
  }
  if (!found_application) {
    fail(at, "it has no application collection");
  }
  result.input_bytes = whole_bytes(input_bits, "input");
  result.output_bytes = whole_bytes(output_bits, "output");
  result.feature_bytes = whole_bytes(feature_bits, "feature");
  return result;
}

}  // namespace forcegrid::driver
