// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <bit>
#include <cstring>
#include <span>
#include <type_traits>

#include "view_link/frame.h"

namespace forcegrid::view_link {

static_assert(std::endian::native == std::endian::little,
              "values are copied as they are in memory; the streams are little-endian");

/// Appends values as they are in memory.
template <typename T>
void append(Bytes& bytes, std::span<const T> values) {
  static_assert(std::is_trivially_copyable_v<T>);
  const std::size_t at = bytes.size();
  bytes.resize(at + values.size_bytes());
  if (!values.empty()) {
    std::memcpy(bytes.data() + at, values.data(), values.size_bytes());
  }
}

template <typename T>
void append(Bytes& bytes, const T& value) {
  append(bytes, std::span<const T>(&value, 1));
}

/// Reads values in order. What is beyond the end reads as zero and leaves ok() false.
/// Threads: one.
class Reader {
 public:
  explicit Reader(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}

  template <typename T>
  T take() {
    static_assert(std::is_trivially_copyable_v<T>);
    T value{};
    take_into(std::span<T>(&value, 1));
    return value;
  }

  template <typename T>
  void take_into(std::span<T> values) {
    if (values.size_bytes() > bytes_.size()) {
      ok_ = false;
      bytes_ = {};
      return;
    }
    if (!values.empty()) {
      std::memcpy(values.data(), bytes_.data(), values.size_bytes());
    }
    bytes_ = bytes_.subspan(values.size_bytes());
  }

  std::size_t left() const noexcept { return bytes_.size(); }
  bool ok() const noexcept { return ok_; }

 private:
  std::span<const std::uint8_t> bytes_;
  bool ok_ = true;
};

}  // namespace forcegrid::view_link
