// SPDX-License-Identifier: Apache-2.0
#include "view/export_record.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <utility>

#include "view/field_slice.h"
#include "view_link/little_endian.h"
#include "view_link/surface_messages.h"

namespace forcegrid::view {
namespace {

using nlohmann::json;
using view_link::Bytes;
using view_link::FeedType;
using view_link::SurfaceType;

constexpr std::array<double, 3> kSlicePeriod_s{0.5, 0.2, 0.5};  // across x, y, z
constexpr std::size_t kSliceHead = 44;                          // bytes before its numbers
constexpr std::uint32_t kExactMantissa = 0xfffff000U;           // 11 bits and the hidden one
constexpr std::size_t kFewest = 16;                             // messages that thin() leaves
constexpr char kMagic[] = {'F', 'G', 'X', '1'};

// Numbers of which what nobody sees is zero, so that they compress.
SharedBytes rounded(Bytes slice) {
  for (std::size_t at = kSliceHead; at + 4 <= slice.size(); at += 4) {
    std::uint32_t bits = 0;
    std::memcpy(&bits, slice.data() + at, sizeof(bits));
    bits &= kExactMantissa;
    std::memcpy(slice.data() + at, &bits, sizeof(bits));
  }
  return std::make_shared<Bytes>(std::move(slice));
}

std::string ordinal(std::size_t number) {
  const std::size_t last = number % 10;
  const bool teen = number / 10 % 10 == 1;
  return std::to_string(number) + (teen || last == 0 || last > 3 ? "th"
                                   : last == 1                   ? "st"
                                   : last == 2                   ? "nd"
                                                                 : "rd");
}

constexpr std::array<const char*, kExportKinds> kWords = {
    "row of the scope", "group of samples", "picture of the arm", "picture of the surface",
    "slice of the field"};

}  // namespace

void ExportRecord::Series::add(double time_s, SharedBytes message) {
  if (all++ % stride == 0) {
    bytes += message->size();
    entries.push_back({time_s, std::move(message), false});
  }
}

void ExportRecord::Series::thin() {
  std::vector<Entry> kept;
  bytes = 0;
  for (std::size_t i = 0; i < entries.size(); i += 2) {
    bytes += entries[i].bytes->size();
    kept.push_back(std::move(entries[i]));
  }
  entries = std::move(kept);
  stride *= 2;
}

ExportRecord::ExportRecord(std::size_t most_bytes)
    : most_bytes_(most_bytes),
      hub_([](const view_link::Frame&, PageCommand::What, bool) { return false; }) {
  viewer_.wake = [] {};
  hub_.join(viewer_);
  while (viewer_.outbox.next()) {  // nothing is connected yet
  }
}

ExportRecord::~ExportRecord() { hub_.forget_viewers(); }

void ExportRecord::take_feed(const view_link::Frame& frame) {
  hub_.take_feed(frame);
  const auto type = static_cast<FeedType>(frame.type);
  if (type == FeedType::kHello) {
    const json hello = json::parse(view_link::text_of(frame));
    const json recording = hello.value("recording", json::object());
    first_ns_ = recording.value("first_ns", std::int64_t{0});
    surfaces_announced_ = recording.value("surface_frames", std::uint64_t{0});
  } else if (type == FeedType::kCycles) {
    view_link::FeedCycle last;
    std::memcpy(&last, frame.payload.data() + frame.payload.size() - sizeof(last), sizeof(last));
    now_s_ = 1e-9 * static_cast<double>(last.time_ns - first_ns_);
  } else if (type == FeedType::kEnd) {
    ended_ = true;
  }
  keep_messages();
  if (type == FeedType::kCycles) {
    keep_slices();
  }
  while (bytes_ > most_bytes_ && thin()) {
  }
}

void ExportRecord::take_surface(std::uint64_t peer, const view_link::Frame& frame) {
  hub_.take_surface(peer, frame);
  ++surfaces_;
  if (static_cast<SurfaceType>(frame.type) == SurfaceType::kFrame) {
    if (const auto decoded = view_link::decode_frame(frame.payload)) {
      surface_s_ = decoded->time_s;
    }
  }
  // The two sockets are not in step.
  const double feed_s = std::exchange(now_s_, surface_s_);
  keep_messages();
  now_s_ = feed_s;
  while (bytes_ > most_bytes_ && thin()) {
  }
}

std::uint64_t ExportRecord::surfaces_missing() const noexcept {
  return surfaces_announced_ - std::min(surfaces_, surfaces_announced_);
}

bool ExportRecord::complete() const noexcept { return ended_ && surfaces_missing() == 0; }

void ExportRecord::keep_messages() {
  while (const auto message = viewer_.outbox.next()) {
    keep(*message);
  }
}

void ExportRecord::keep(const PageMessage& message) {
  if (message.text) {
    const json text = json::parse(*message.bytes);
    const std::string type = text.value("type", "");
    if (type == "hello" || type == "note") {
      always_.push_back({now_s_, message.bytes, true});
      bytes_ += message.bytes->size();
    }
    return;
  }
  const auto add = [&](ExportKind kind, std::uint32_t key) {
    Series& series = group(kind)[key];
    const std::size_t before = series.bytes;
    series.add(now_s_, message.bytes);
    bytes_ += series.bytes - before;
  };
  const std::uint32_t object = message.bytes->at(1);
  switch (static_cast<PageType>(message.bytes->at(0))) {
    case PageType::kScope:
      return add(ExportKind::kRows, 0);
    case PageType::kSamples:
      return add(ExportKind::kSamples, 0);
    case PageType::kArm:
      return add(ExportKind::kArm, 0);
    case PageType::kSurface:
      return add(ExportKind::kSurface, object);
    case PageType::kShape:
      always_.push_back({now_s_, message.bytes, false});
      bytes_ += message.bytes->size();
      return;
    case PageType::kField:   // keep_slices() makes them
    case PageType::kBlocks:  // nobody asks for these here
    case PageType::kInsideLines:
    case PageType::kInsideFrame:
      return;
  }
}

// One slice of each method, across each axis.
void ExportRecord::keep_slices() {
  const MethodCopies* const copies = hub_.copies();
  if (copies == nullptr || !hub_.touching_W().allFinite()) {
    return;
  }
  for (std::uint32_t normal = 0; normal < 3; ++normal) {
    if (now_s_ < next_slice_s_[normal]) {
      continue;
    }
    next_slice_s_[normal] = now_s_ + kSlicePeriod_s[normal];
    for (std::uint32_t method = 0; method < copies->size(); ++method) {
      SliceWish wish;
      wish.method = method;
      wish.normal = static_cast<int>(normal);
      Series& series = group(ExportKind::kField)[4 * method + normal];
      const std::size_t before = series.bytes;
      series.add(now_s_, rounded(slice_message(*copies, wish, hub_.touching_W())));
      bytes_ += series.bytes - before;
    }
  }
}

bool ExportRecord::thin() {
  Group* largest = nullptr;
  std::size_t most = 0;
  for (Group& each : groups_) {
    std::size_t bytes = 0;
    std::size_t longest = 0;
    for (const auto& [key, series] : each) {
      bytes += series.bytes;
      longest = std::max(longest, series.entries.size());
    }
    if (longest > kFewest && bytes > most) {
      most = bytes;
      largest = &each;
    }
  }
  if (largest == nullptr) {
    return false;
  }
  for (auto& [key, series] : *largest) {
    bytes_ -= series.bytes;
    series.thin();
    bytes_ += series.bytes;
  }
  return true;
}

ExportRecord::Kept ExportRecord::kept(ExportKind kind) const noexcept {
  Kept sum;
  for (const auto& [key, series] : group(kind)) {
    sum.kept += series.entries.size();
    sum.all += series.all;
  }
  return sum;
}

std::string ExportRecord::left_out() const {
  std::string text;
  for (std::size_t kind = 0; kind < kExportKinds; ++kind) {
    std::size_t stride = 1;
    for (const auto& [key, series] : groups_[kind]) {
      stride = std::max(stride, series.stride);
    }
    if (stride > 1) {
      text += (text.empty() ? "every " : ", every ") + ordinal(stride) + " " + kWords[kind];
    }
  }
  return text;
}

Bytes ExportRecord::pack(const std::string& note) const {
  std::vector<const Entry*> entries;
  for (const Entry& entry : always_) {
    entries.push_back(&entry);
  }
  for (const Group& each : groups_) {
    for (const auto& [key, series] : each) {
      for (const Entry& entry : series.entries) {
        entries.push_back(&entry);
      }
    }
  }
  Entry added{0.0, nullptr, true};
  if (!note.empty()) {
    const std::string text =
        json{{"type", "note"}, {"level", "warn"}, {"component", "export"}, {"text", note}}.dump();
    added.bytes = std::make_shared<Bytes>(text.begin(), text.end());
    entries.push_back(&added);
  }
  std::stable_sort(entries.begin(), entries.end(),
                   [](const Entry* a, const Entry* b) { return a->time_s < b->time_s; });
  Bytes bytes(std::begin(kMagic), std::end(kMagic));
  for (const Entry* entry : entries) {
    view_link::append(bytes, entry->time_s);
    view_link::append(bytes, static_cast<std::uint32_t>(entry->bytes->size()));
    view_link::append(bytes, std::uint32_t{entry->is_text ? 1U : 0U});
    view_link::append(bytes, std::span<const std::uint8_t>(*entry->bytes));
  }
  return bytes;
}

}  // namespace forcegrid::view
