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
constexpr double kPlacePeriod_s = 0.0155;                       // of a tool beside another one
constexpr std::uint32_t kToolStep = 256;                        // of the word before a message
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
    "row of the scope",       "group of samples",   "picture of the arm",
    "picture of the surface", "slice of the field", "place of a tool"};

}  // namespace

// A tool's recording, as its hub tells a page of it.
struct ExportRecord::Tool {
  Tool(std::size_t number, std::uint64_t its_peer, const std::shared_ptr<Surfaces>& surfaces)
      : place(static_cast<std::uint32_t>(number)),
        peer(its_peer),
        hub([](const view_link::Frame&, PageCommand::What, bool) { return false; },
            HubOptions{.tool = number, .surfaces = surfaces, .inside_wished_elsewhere = {}}) {
    viewer.wake = [] {};
    hub.join(viewer);
    while (viewer.outbox.next()) {  // nothing is connected yet
    }
  }
  ~Tool() { hub.forget_viewers(); }
  Tool(const Tool&) = delete;
  Tool& operator=(const Tool&) = delete;

  std::uint32_t place;
  std::uint64_t peer;
  Hub hub;
  Viewer viewer;
  std::int64_t first_ns = 0;
  double now_s = 0.0;
  std::array<double, 3> next_slice_s{};  // by normal
  double next_place_s = 0.0;
  bool ended = false;
};

void ExportRecord::Series::add(double time_s, SharedBytes message, std::uint32_t tool) {
  if (all++ % stride == 0) {
    bytes += message->size();
    entries.push_back({time_s, std::move(message), false, tool});
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
    : most_bytes_(most_bytes), shared_surfaces_(std::make_shared<Surfaces>(Surfaces::Tell{})) {}

ExportRecord::~ExportRecord() = default;

ExportRecord::Tool& ExportRecord::tool_of(std::uint64_t peer, const view_link::Frame& frame) {
  for (const auto& tool : tools_) {
    if (tool && tool->peer == peer) {
      return *tool;
    }
  }
  if (frame.object >= tools_.size() || tools_[frame.object]) {
    throw view_link::ViewLinkError("a feed of tool " + std::to_string(frame.object) +
                                   ", which is none, or another one's");
  }
  tools_[frame.object] = std::make_unique<Tool>(frame.object, peer, shared_surfaces_);
  return *tools_[frame.object];
}

void ExportRecord::begin(Tool& tool, const view_link::Frame& hello) {
  const json recording = json::parse(view_link::text_of(hello)).value("recording", json::object());
  tool.first_ns = recording.value("first_ns", std::int64_t{0});
  tools_announced_ = recording.value("tools", std::size_t{1});
  surfaces_announced_ = recording.value("surface_frames", std::uint64_t{0});
}

void ExportRecord::take_feed(std::uint64_t peer, const view_link::Frame& frame) {
  Tool& tool = tool_of(peer, frame);
  tool.hub.take_feed(frame);
  const auto type = static_cast<FeedType>(frame.type);
  if (type == FeedType::kHello) {
    begin(tool, frame);
  } else if (type == FeedType::kEnd) {
    tool.ended = true;
  } else if (type == FeedType::kCycles) {
    view_link::FeedCycle last;
    std::memcpy(&last, frame.payload.data() + frame.payload.size() - sizeof(last), sizeof(last));
    tool.now_s = 1e-9 * static_cast<double>(last.time_ns - tool.first_ns);
    keep_place(tool, last);
  }
  keep_messages(tool.viewer.outbox, tool.now_s, tool.place);
  if (type == FeedType::kCycles) {
    keep_slices(tool);
  }
  while (bytes_ > most_bytes_ && thin()) {
  }
}

void ExportRecord::take_surface(std::uint64_t peer, const view_link::Frame& frame) {
  if (const auto news = shared_surfaces_->take(peer, frame)) {
    if (!news->is_inside()) {
      news->put(surface_outbox_);
    }
  }
  ++surfaces_;
  if (static_cast<SurfaceType>(frame.type) == SurfaceType::kFrame) {
    if (const auto decoded = view_link::decode_frame(frame.payload)) {
      surface_s_ = decoded->time_s;
    }
  }
  keep_messages(surface_outbox_, surface_s_, 0);
  while (bytes_ > most_bytes_ && thin()) {
  }
}

std::uint64_t ExportRecord::surfaces_missing() const noexcept {
  return surfaces_announced_ - std::min(surfaces_, surfaces_announced_);
}

bool ExportRecord::complete() const noexcept {
  const auto ended =
      std::ranges::count_if(tools_, [](const auto& tool) { return tool && tool->ended; });
  return static_cast<std::size_t>(ended) >= tools_announced_ && surfaces_missing() == 0;
}

void ExportRecord::keep_messages(Outbox& outbox, double time_s, std::uint32_t tool) {
  while (const auto message = outbox.next()) {
    keep(*message, time_s, tool);
  }
}

void ExportRecord::add(ExportKind kind, std::uint32_t key, double time_s, SharedBytes message,
                       std::uint32_t tool) {
  Series& series = group(kind)[kToolStep * key + tool];
  const std::size_t before = series.bytes;
  series.add(time_s, std::move(message), tool);
  bytes_ += series.bytes - before;
}

void ExportRecord::keep(const PageMessage& message, double time_s, std::uint32_t tool) {
  const auto always = [&] {
    always_.push_back({time_s, message.bytes, message.text, tool});
    bytes_ += message.bytes->size();
  };
  if (message.text) {
    const json text = json::parse(*message.bytes);
    const std::string type = text.value("type", "");
    if (type == "hello" || type == "note") {
      always();
    }
    return;
  }
  switch (static_cast<PageType>(message.bytes->at(0))) {
    case PageType::kScope:
      return add(ExportKind::kRows, 0, time_s, message.bytes, tool);
    case PageType::kSamples:
      return add(ExportKind::kSamples, 0, time_s, message.bytes, tool);
    case PageType::kArm:
      return add(ExportKind::kArm, 0, time_s, message.bytes, tool);
    case PageType::kSurface:
      return add(ExportKind::kSurface, message.bytes->at(1), time_s, message.bytes, tool);
    case PageType::kShape:
      return always();
    case PageType::kField:      // keep_slices() makes them
    case PageType::kOtherTool:  // keep_place() does
    case PageType::kBlocks:     // nobody asks for these here
    case PageType::kInsideLines:
    case PageType::kInsideFrame:
      return;
  }
}

// Where it is while another tool's scope is shown.
void ExportRecord::keep_place(Tool& tool, const view_link::FeedCycle& newest) {
  if (tools_announced_ > 1 && tool.now_s >= tool.next_place_s) {
    tool.next_place_s = tool.now_s + kPlacePeriod_s;
    add(ExportKind::kPlaces, 0, tool.now_s, other_tool_message(tool.place, newest), tool.place);
  }
}

// One slice of each method, across each axis.
void ExportRecord::keep_slices(Tool& tool) {
  const MethodCopies* const copies = tool.hub.copies();
  if (copies == nullptr || !tool.hub.touching_W().allFinite()) {
    return;
  }
  for (std::uint32_t normal = 0; normal < 3; ++normal) {
    if (tool.now_s < tool.next_slice_s[normal]) {
      continue;
    }
    tool.next_slice_s[normal] = tool.now_s + kSlicePeriod_s[normal];
    for (std::uint32_t method = 0; method < copies->size(); ++method) {
      SliceWish wish;
      wish.method = method;
      wish.normal = static_cast<int>(normal);
      add(ExportKind::kField, 4 * method + normal, tool.now_s,
          rounded(slice_message(*copies, wish, tool.hub.touching_W())), tool.place);
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
  Entry added{0.0, nullptr, true, 0};
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
    view_link::append(bytes, (entry->is_text ? 1U : 0U) + kToolStep * entry->tool);
    view_link::append(bytes, std::span<const std::uint8_t>(*entry->bytes));
  }
  return bytes;
}

}  // namespace forcegrid::view
