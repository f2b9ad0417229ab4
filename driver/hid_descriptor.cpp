// SPDX-License-Identifier: Apache-2.0
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

/// The state of a descriptor's parser, item by item.
class Parser {
 public:
  explicit Parser(std::span<const std::uint8_t> descriptor) noexcept : descriptor_(descriptor) {}

  HidInterface parse() {
    while (at_ < descriptor_.size()) {
      take_item();
    }
    if (depth_ != 0) {
      fail(at_, "it ends inside a collection");
    }
    if (!found_application_) {
      fail(at_, "it has no application collection");
    }
    result_.input_bytes = whole_bytes(input_bits_, "input");
    result_.output_bytes = whole_bytes(output_bits_, "output");
    result_.feature_bytes = whole_bytes(feature_bits_, "feature");
    return result_;
  }

 private:
  void take_item() {
    start_ = at_;
    const unsigned prefix = descriptor_[at_++];
    if (prefix == 0xFE) {
      fail(start_, "a long item, which HID 1.11 reserves");
    }
    const std::uint32_t value = take_value((prefix & 3) == 3 ? 4 : prefix & 3);
    const unsigned tag = prefix >> 4;
    switch ((prefix >> 2) & 3) {
      case kMain:
        take_main(tag, value);
        break;
      case kGlobal:
        take_global(tag, value);
        break;
      case kLocal:
        take_local(tag, value);
        break;
      default:
        fail(start_, "reserved item type");
    }
  }

  std::uint32_t take_value(std::size_t size) {
    if (descriptor_.size() - at_ < size) {
      fail(start_, "the item needs " + std::to_string(size) + " more bytes and " +
                       std::to_string(descriptor_.size() - at_) + " are left");
    }
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < size; ++i) {
      value |= static_cast<std::uint32_t>(descriptor_[at_ + i]) << (8 * i);
    }
    at_ += size;
    return value;
  }

  void take_main(unsigned tag, std::uint32_t value) {
    switch (tag) {
      case kInput:
        add_field(input_bits_);
        break;
      case kOutput:
        add_field(output_bits_);
        break;
      case kFeature:
        add_field(feature_bits_);
        break;
      case kCollection:
        begin_collection(value);
        break;
      case kEndCollection:
        if (depth_ == 0) {
          fail(start_, "the end of a collection that was not begun");
        }
        --depth_;
        break;
      default:
        fail(start_, "unknown main item");
    }
    has_usage_ = false;
  }

  void add_field(std::uint64_t& bits) const {
    if (depth_ == 0) {
      fail(start_, "a report field outside any collection");
    }
    bits += static_cast<std::uint64_t>(globals_.report_size) * globals_.report_count;
    if (bits > kMaxReportBits) {
      fail(start_, "a report of more than " + std::to_string(kMaxReportBits / 8) + " bytes");
    }
  }

  void begin_collection(std::uint32_t kind) {
    if (++depth_ > kMaxDepth) {
      fail(start_, "collections nested deeper than " + std::to_string(kMaxDepth));
    }
    if (kind != kApplication || found_application_) {
      return;
    }
    if (!has_usage_) {
      fail(start_, "an application collection without a usage");
    }
    found_application_ = true;
    const std::uint32_t page = first_usage_ > 0xFFFF ? first_usage_ >> 16 : globals_.usage_page;
    result_.usage_page = static_cast<std::uint16_t>(page);
    result_.usage = static_cast<std::uint16_t>(first_usage_ & 0xFFFF);
  }

  void take_global(unsigned tag, std::uint32_t value) {
    switch (tag) {
      case kUsagePage:
        if (value > 0xFFFF) {
          fail(start_, "a usage page above 0xFFFF");
        }
        globals_.usage_page = value;
        break;
      case kReportSize:
        globals_.report_size = value;
        break;
      case kReportId:
        result_.has_report_ids = true;
        break;
      case kReportCount:
        globals_.report_count = value;
        break;
      case kPush:
        if (pushed_.size() >= kMaxDepth) {
          fail(start_, "more than " + std::to_string(kMaxDepth) + " pushed states");
        }
        pushed_.push_back(globals_);
        break;
      case kPop:
        if (pushed_.empty()) {
          fail(start_, "a pop without a push");
        }
        globals_ = pushed_.back();
        pushed_.pop_back();
        break;
      default:  // limits, exponent and unit of the values do not matter here
        if (tag > kPop) {
          fail(start_, "unknown global item");
        }
    }
  }

  void take_local(unsigned tag, std::uint32_t value) {
    if (tag > kLastLocalTag) {
      fail(start_, "unknown local item");
    }
    if (tag == kUsage && !has_usage_) {
      has_usage_ = true;
      first_usage_ = value;
    }
  }

  std::span<const std::uint8_t> descriptor_;
  std::size_t at_ = 0;
  std::size_t start_ = 0;  ///< of the current item
  HidInterface result_;
  Globals globals_;
  std::vector<Globals> pushed_;
  std::size_t depth_ = 0;
  bool found_application_ = false;
  bool has_usage_ = false;
  std::uint32_t first_usage_ = 0;  ///< one of four bytes carries its own page in the upper half
  std::uint64_t input_bits_ = 0;
  std::uint64_t output_bits_ = 0;
  std::uint64_t feature_bits_ = 0;
};

}  // namespace

HidInterface parse_hid_descriptor(std::span<const std::uint8_t> descriptor) {
  if (descriptor.empty() || descriptor.size() > kMaxDescriptorBytes) {
    throw DeviceError("HID report descriptor: it has " + std::to_string(descriptor.size()) +
                      " bytes");
  }
  return Parser(descriptor).parse();
}

}  // namespace forcegrid::driver
