// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <bit>
#include <cstdint>

namespace forcegrid {

/// A number in half precision (IEEE 754 binary16): 11 bits of mantissa, up to 65504. Stored, never
/// computed with. Where the processor converts by itself, as a Cortex-M7 does, it is asked to; all
/// answers are the same.
class Half {
 public:
  static constexpr float kLargest = 65504.0F;

  constexpr Half() noexcept = default;
  /// The nearest half, ties to even; infinite from 65520 on.
  explicit Half(float value) noexcept : bits_(bits_of(value)) {}

  float value() const noexcept {
#ifdef __ARM_FP16_FORMAT_IEEE
    return static_cast<float>(std::bit_cast<__fp16>(bits_));
#else
    const std::uint32_t sign = static_cast<std::uint32_t>(bits_ & 0x8000) << 16;
    const std::uint32_t size = bits_ & 0x7fff;
    if (size < 0x0400) {  // subnormal: multiples of 2^-24
      return std::bit_cast<float>(
          sign | std::bit_cast<std::uint32_t>(static_cast<float>(size) * 0x1p-24F));
    }
    const std::uint32_t rebiased =
        size < 0x7c00 ? (size << 13) + (112U << 23) : (size << 13) + (224U << 23);  // inf, NaN
    return std::bit_cast<float>(sign | rebiased);
#endif
  }

  static constexpr Half from_bits(std::uint16_t bits) noexcept {
    Half half;
    half.bits_ = bits;
    return half;
  }
  constexpr std::uint16_t bits() const noexcept { return bits_; }

 private:
  static std::uint16_t bits_of(float value) noexcept {
#ifdef __ARM_FP16_FORMAT_IEEE
    return std::bit_cast<std::uint16_t>(static_cast<__fp16>(value));
#else
    const auto all = std::bit_cast<std::uint32_t>(value);
    const auto sign = static_cast<std::uint16_t>(all >> 16 & 0x8000);
    const std::uint32_t size = all & 0x7fffffff;
    std::uint32_t half = 0;
    if (size >= 0x47800000) {  // 65536 and more
      half = size > 0x7f800000 ? 0x7e00 : 0x7c00;
    } else if (size >= 0x38800000) {  // normal: the exponent rebiased, 13 bits rounded away
      half = (size - 0x38000000 + 0x0fff + (size >> 13 & 1)) >> 13;
    } else {  // subnormal: beside 1/2 a float has steps of 2^-24, so the sum rounds
      half = std::bit_cast<std::uint32_t>(std::bit_cast<float>(size) + 0.5F) - 0x3f000000;
    }
    return static_cast<std::uint16_t>(sign | half);
#endif
  }

  std::uint16_t bits_ = 0;
};
static_assert(sizeof(Half) == 2);

}  // namespace forcegrid
