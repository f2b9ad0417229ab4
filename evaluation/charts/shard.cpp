// SPDX-License-Identifier: Apache-2.0
#include "evaluation/charts/shard.h"

#include <charconv>
#include <stdexcept>

namespace forcegrid::evaluation {
namespace {

constexpr std::size_t kMostShards = 100'000;

}  // namespace

Shard parse_shard(const std::string& text) {
  Shard shard;
  const char* const end = text.data() + text.size();
  const auto number = std::from_chars(text.data(), end, shard.number);
  const bool slash = number.ec == std::errc{} && number.ptr != end && *number.ptr == '/';
  const auto count = slash ? std::from_chars(number.ptr + 1, end, shard.count) : number;
  if (!slash || count.ec != std::errc{} || count.ptr != end || shard.number < 1 ||
      shard.number > shard.count || shard.count > kMostShards) {
    throw std::invalid_argument("'" + text +
                                "' is no part of a chart; write I/N, for example 2/8 "
                                "for the second of eight");
  }
  return shard;
}

}  // namespace forcegrid::evaluation
