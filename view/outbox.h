// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>

#include "view/messages.h"
#include "view/scope_rows.h"

namespace forcegrid::view {

inline constexpr std::size_t kMostObjects = 4;

/// A message to a page.
struct PageMessage {
  bool text = false;
  SharedBytes bytes;
};

/// What waits for one page. It is bounded: a page that does not read keeps the newest scope rows
/// and samples, and of surfaces, insides, arms, tools, field and blocks the newest alone.
/// Real-time: no. Threads: one.
class Outbox {
 public:
  static constexpr std::size_t kMostTextBytes = std::size_t{512} << 10;
  static constexpr std::size_t kMostRows = 6000;  ///< a minute
  static constexpr std::size_t kMostSamples = 4096;

  /// A text. @param after_rows  it goes after the rows and samples that wait; others go first.
  void add_text(std::string text, bool after_rows = false);
  void add_row(const ScopeRow& row);
  void add_sample(const std::array<std::uint8_t, kSampleBytes>& sample);
  /// @param tool  < kMostTools
  void set_arm(std::size_t tool, SharedBytes message);
  void set_other_tool(std::size_t tool, SharedBytes message);
  void set_field(SharedBytes message);   ///< nothing: the page wants none any more
  void set_blocks(SharedBytes message);  ///< likewise
  /// A shape also takes the place of its object's frame and inside that wait.
  /// @param object  < kMostObjects
  void set_shape(std::size_t object, SharedBytes message);
  void set_surface(std::size_t object, SharedBytes message);
  void forget_surface(std::size_t object);
  /// Lines also take the place of their object's frame that waits.
  void set_inside_lines(std::size_t object, SharedBytes message);
  void set_inside_frame(std::size_t object, SharedBytes message);
  void forget_inside(std::size_t object);
  /// Drops rows, samples, field, blocks and the arm of the tool: another run of it begins.
  /// @param tool  < kMostTools
  void forget_run(std::size_t tool);

  /// Texts first, then shapes, then lines, then the other kinds in turn. Nothing: nothing waits.
  std::optional<PageMessage> next();

  /// More texts wait than kMostTextBytes: the page is not to be waited for.
  bool overrun() const noexcept { return text_bytes_ > kMostTextBytes; }
  std::uint64_t dropped() const noexcept { return dropped_; }  ///< rows, samples, frames

 private:
  struct Text {
    SharedBytes bytes;
    bool after_rows;
  };
  std::optional<PageMessage> next_in_turn();
  std::optional<PageMessage> take_rows();
  std::optional<PageMessage> take_samples();

  std::deque<Text> texts_;
  std::size_t text_bytes_ = 0;
  std::deque<ScopeRow> rows_;
  std::deque<std::array<std::uint8_t, kSampleBytes>> samples_;
  SharedBytes field_;
  SharedBytes blocks_;
  std::array<SharedBytes, kMostObjects> shapes_;
  std::array<SharedBytes, kMostObjects> surfaces_;
  std::array<SharedBytes, kMostObjects> inside_lines_;
  std::array<SharedBytes, kMostObjects> inside_frames_;
  std::array<SharedBytes, kMostTools> arms_;
  std::array<SharedBytes, kMostTools> other_tools_;
  std::size_t turn_ = 0;
  std::uint64_t dropped_ = 0;
};

}  // namespace forcegrid::view
