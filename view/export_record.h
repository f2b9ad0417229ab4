// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "view/hub.h"
#include "view/messages.h"
#include "view_link/frame.h"

namespace forcegrid::view {

/// Kinds of messages of which an exported page may hold fewer than the recording has.
enum class ExportKind : std::uint8_t { kRows, kSamples, kArm, kSurface, kField };
inline constexpr std::size_t kExportKinds = 5;

/// Everything that a page would be told of a recording, with the recording's time of each message.
/// Fed as the live view is (docs/view_protocol.md); what the page of an exported file reads is
/// pack() (view/page/exported.js). Real-time: no. Threads: one.
class ExportRecord {
 public:
  /// @param most_bytes  more messages are not kept: of the kind with the most bytes every other one
  /// goes, as often as it takes.
  explicit ExportRecord(std::size_t most_bytes);
  ~ExportRecord();
  ExportRecord(const ExportRecord&) = delete;
  ExportRecord& operator=(const ExportRecord&) = delete;

  /// As Hub's. @throws view_link::ViewLinkError saying what is wrong with the frame.
  void take_feed(const view_link::Frame& frame);
  void take_surface(std::uint64_t peer, const view_link::Frame& frame);

  /// Has the end come, with every frame of the surface that the hello announced?
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
  /// text, and the message. @param note  a text for the page's list of notes; may be empty.
  view_link::Bytes pack(const std::string& note) const;

 private:
  struct Entry {
    double time_s;
    SharedBytes bytes;
    bool is_text;
  };
  /// Messages of which every stride-th is kept.
  struct Series {
    std::vector<Entry> entries;
    std::size_t stride = 1;
    std::size_t all = 0;
    std::size_t bytes = 0;

    void add(double time_s, SharedBytes message);
    void thin();
  };
  /// By object, or by method and normal: each is thinned by itself.
  using Group = std::map<std::uint32_t, Series>;

  void keep_messages();
  void keep(const PageMessage& message);
  void keep_slices();
  Group& group(ExportKind kind) { return groups_[static_cast<std::size_t>(kind)]; }
  const Group& group(ExportKind kind) const { return groups_[static_cast<std::size_t>(kind)]; }

  std::size_t most_bytes_;
  std::size_t bytes_ = 0;
  Hub hub_;
  Viewer viewer_;
  std::vector<Entry> always_;  ///< texts and shapes
  std::array<Group, kExportKinds> groups_;
  std::int64_t first_ns_ = 0;
  double now_s_ = 0.0;
  double surface_s_ = 0.0;                ///< of the newest picture of a surface
  std::array<double, 3> next_slice_s_{};  ///< by normal
  std::uint64_t surfaces_announced_ = 0;
  std::uint64_t surfaces_ = 0;
  bool ended_ = false;
};

}  // namespace forcegrid::view
