// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>

namespace forcegrid::evaluation {

/// One of several parts of a chart, each made by a process of its own, perhaps on a machine of its
/// own. merge_rows() puts their rows together.
struct Shard {
  std::size_t number = 1;  ///< from 1 on
  std::size_t count = 1;   ///< 1: the whole chart

  [[nodiscard]] bool whole() const noexcept { return count == 1; }
  /// Whether it has piece `piece` of `pieces`; neighbours, which share force tables, mostly come
  /// into one shard.
  [[nodiscard]] bool has(std::size_t piece, std::size_t pieces) const noexcept {
    return piece * count / pieces == number - 1;
  }
};

/// Reads "2/8", the second of eight.
/// @throws std::invalid_argument with what to write instead.
Shard parse_shard(const std::string& text);

}  // namespace forcegrid::evaluation
