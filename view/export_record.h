// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "view/hub.h"
#include "view/messages.h"
#include "view/outbox.h"
#include "view/surfaces.h"
#include "view_link/frame.h"

namespace forcegrid::view {

/// Kinds of messages of which an exported page may hold fewer than the recording has.
enum class ExportKind : std::uint8_t { kRows, kSamples, kArm, kSurface, kField, kPlaces };
inline constexpr std::size_t kExportKinds = 6;

/// Everything that a page would be told of the recordings of one run, with the recordings' time of
/// each message. Fed as the live view is (docs/view_protocol.md); what the page of an exported file
/// reads is pack() (view/page/exported.js). Real-time: no. Threads: one.
class ExportRecord {
 public:
  /// @param most_bytes  more messages are not kept: of the kind with the most bytes every other one
  /// goes, as often as it takes.
  explicit ExportRecord(std::size_t most_bytes);
  ~ExportRecord();
  ExportRecord(const ExportRecord&) = delete;
  ExportRecord& operator=(const ExportRecord&) = delete;

  /// As ToolHubs'. @throws view_link::ViewLinkError saying what is wrong with the frame.
  void take_feed(std::uint64_t peer, const view_link::Frame& frame);
  void take_surface(std::uint64_t peer, const view_link::Frame& frame);

  /// Has the end of every tool come, with every frame of the surface that a hello announced?
  bool complete() const noexcept;
  /// Frames and shapes of surfaces that are still to come.
  std::uint64_t surfaces_missing() const noexcept;

  /// Leaves out every other message of the kind with the most bytes. False: there is nothing left
  /// to leave out.
  bool thin();

  /// Messages that are kept, and that there were.
  struct Kept {
    std::size_t kept = 0;
    std::size_t all = 0;
  };
  Kept kept(ExportKind kind) const noexcept;
  /// "every 2nd picture of the surface, ..."; empty: everything is there.
  std::string left_out() const;

  /// All messages in order of time: u32 "FGX1", then for each f64 time [s], u32 bytes, u32 1 for a
  /// text and 0 for another plus 256 times the place of its tool, and the message. @param note  a
  /// text for the page's list of notes; may be empty.
  view_link::Bytes pack(const std::string& note) const;

 private:
  struct Entry {
    double time_s;
    SharedBytes bytes;
    bool is_text;
    std::uint32_t tool;
  };
  struct Tool;
  /// Messages of which every stride-th is kept.
  struct Series {
    std::vector<Entry> entries;
    std::size_t stride = 1;
    std::size_t all = 0;
    std::size_t bytes = 0;

    void add(double time_s, SharedBytes message, std::uint32_t tool);
    void thin();
  };
  /// By object, or by tool, method and normal: each is thinned by itself.
  using Group = std::map<std::uint32_t, Series>;

  Tool& tool_of(std::uint64_t peer, const view_link::Frame& frame);
  void begin(Tool& tool, const view_link::Frame& hello);
  void keep_messages(Outbox& outbox, double time_s, std::uint32_t tool);
  void keep(const PageMessage& message, double time_s, std::uint32_t tool);
  void add(ExportKind kind, std::uint32_t key, double time_s, SharedBytes message,
           std::uint32_t tool);
  void keep_place(Tool& tool, const view_link::FeedCycle& newest);
  void keep_slices(Tool& tool);
  Group& group(ExportKind kind) { return groups_[static_cast<std::size_t>(kind)]; }
  const Group& group(ExportKind kind) const { return groups_[static_cast<std::size_t>(kind)]; }

  std::size_t most_bytes_;
  std::size_t bytes_ = 0;
  std::shared_ptr<Surfaces> shared_surfaces_;
  Outbox surface_outbox_;
  std::array<std::unique_ptr<Tool>, kMostTools> tools_;  ///< by place
  std::vector<Entry> always_;                            ///< texts and shapes
  std::array<Group, kExportKinds> groups_;
  double surface_s_ = 0.0;  ///< of the newest picture of a surface
  std::size_t tools_announced_ = 1;
  std::uint64_t surfaces_announced_ = 0;
  std::uint64_t surfaces_ = 0;
};

}  // namespace forcegrid::view
