// SPDX-License-Identifier: Apache-2.0
#include "view/outbox.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "view_link/little_endian.h"

namespace forcegrid::view {
namespace {

constexpr std::size_t kMostRowsOfAMessage = 1024;
constexpr std::size_t kFirstSurface = 4;  // after rows, samples, field, blocks
constexpr std::size_t kFirstInside = kFirstSurface + kMostObjects;
constexpr std::size_t kFirstArm = kFirstInside + kMostObjects;
constexpr std::size_t kFirstTool = kFirstArm + kMostTools;
constexpr std::size_t kTurns = kFirstTool + kMostTools;

std::optional<PageMessage> take_binary(SharedBytes& waiting) {
  if (!waiting) {
    return std::nullopt;
  }
  return PageMessage{false, std::exchange(waiting, nullptr)};
}

}  // namespace

void Outbox::add_text(std::string text, bool after_rows) {
  text_bytes_ += text.size();
  texts_.push_back({std::make_shared<view_link::Bytes>(text.begin(), text.end()), after_rows});
}

void Outbox::add_row(const ScopeRow& row) {
  if (rows_.size() == kMostRows) {
    rows_.pop_front();
    ++dropped_;
  }
  rows_.push_back(row);
}

void Outbox::add_sample(const std::array<std::uint8_t, kSampleBytes>& sample) {
  if (samples_.size() == kMostSamples) {
    samples_.pop_front();
    ++dropped_;
  }
  samples_.push_back(sample);
}

void Outbox::set_arm(std::size_t tool, SharedBytes message) {
  dropped_ += arms_[tool] ? 1 : 0;
  arms_[tool] = std::move(message);
}

void Outbox::set_other_tool(std::size_t tool, SharedBytes message) {
  dropped_ += other_tools_[tool] ? 1 : 0;
  other_tools_[tool] = std::move(message);
}

void Outbox::set_field(SharedBytes message) {
  dropped_ += field_ ? 1 : 0;
  field_ = std::move(message);
}

void Outbox::set_blocks(SharedBytes message) {
  dropped_ += blocks_ ? 1 : 0;
  blocks_ = std::move(message);
}

void Outbox::set_shape(std::size_t object, SharedBytes message) {
  forget_surface(object);
  shapes_[object] = std::move(message);
}

void Outbox::set_surface(std::size_t object, SharedBytes message) {
  dropped_ += surfaces_[object] ? 1 : 0;
  surfaces_[object] = std::move(message);
}

void Outbox::forget_surface(std::size_t object) {
  shapes_[object] = nullptr;
  surfaces_[object] = nullptr;
  forget_inside(object);
}

void Outbox::set_inside_lines(std::size_t object, SharedBytes message) {
  forget_inside(object);
  inside_lines_[object] = std::move(message);
}

void Outbox::set_inside_frame(std::size_t object, SharedBytes message) {
  dropped_ += inside_frames_[object] ? 1 : 0;
  inside_frames_[object] = std::move(message);
}

void Outbox::forget_inside(std::size_t object) {
  inside_lines_[object] = nullptr;
  inside_frames_[object] = nullptr;
}

void Outbox::forget_run(std::size_t tool) {
  rows_.clear();
  samples_.clear();
  arms_[tool] = nullptr;
  field_ = nullptr;
  blocks_ = nullptr;
}

std::optional<PageMessage> Outbox::next() {
  if (!texts_.empty()) {
    if (texts_.front().after_rows && !rows_.empty()) {
      return take_rows();
    }
    if (texts_.front().after_rows && !samples_.empty()) {
      return take_samples();
    }
    PageMessage message{true, std::move(texts_.front().bytes)};
    texts_.pop_front();
    text_bytes_ -= message.bytes->size();
    return message;
  }
  for (auto* const kind : {&shapes_, &inside_lines_}) {
    for (SharedBytes& shape : *kind) {
      if (auto message = take_binary(shape)) {
        return message;
      }
    }
  }
  for (std::size_t tried = 0; tried < kTurns; ++tried) {
    turn_ = (turn_ + 1) % kTurns;
    if (auto message = next_in_turn()) {
      return message;
    }
  }
  return std::nullopt;
}

std::optional<PageMessage> Outbox::next_in_turn() {
  switch (turn_) {
    case 0:
      return take_rows();
    case 1:
      return take_samples();
    case 2:
      return take_binary(field_);
    case 3:
      return take_binary(blocks_);
    default:
      return take_binary(turn_ < kFirstInside ? surfaces_[turn_ - kFirstSurface]
                         : turn_ < kFirstArm  ? inside_frames_[turn_ - kFirstInside]
                         : turn_ < kFirstTool ? arms_[turn_ - kFirstArm]
                                              : other_tools_[turn_ - kFirstTool]);
  }
}

std::optional<PageMessage> Outbox::take_rows() {
  if (rows_.empty()) {
    return std::nullopt;
  }
  const auto end =
      rows_.begin() + static_cast<std::ptrdiff_t>(std::min(rows_.size(), kMostRowsOfAMessage));
  const std::vector<ScopeRow> rows(rows_.begin(), end);
  rows_.erase(rows_.begin(), end);
  return PageMessage{false, std::make_shared<view_link::Bytes>(scope_message(rows))};
}

std::optional<PageMessage> Outbox::take_samples() {
  if (samples_.empty()) {
    return std::nullopt;
  }
  view_link::Bytes bytes = message_head(PageType::kSamples, 0);
  const auto count = static_cast<std::uint16_t>(samples_.size());
  bytes.resize(2);
  view_link::append(bytes, count);
  view_link::append(bytes, std::uint32_t{0});
  for (const auto& sample : samples_) {
    view_link::append(bytes, sample);
  }
  samples_.clear();
  return PageMessage{false, std::make_shared<view_link::Bytes>(std::move(bytes))};
}

}  // namespace forcegrid::view
